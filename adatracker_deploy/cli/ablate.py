"""``ablate``: train with parts left out, from several seeds, and tell what each part is worth."""

from __future__ import annotations

import argparse
import json
import os
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING

from adatracker_deploy.cli.training_options import add_settings, settings_of
from adatracker_deploy.core.errors import UsageError

if TYPE_CHECKING:
    from adatracker_deploy.evaluation.ablation import ArmScore


def add_parser(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add ``ablate``."""
    parser = commands.add_parser(
        "ablate",
        help="train with parts left out and compare",
        description="Train the whole method and variants without one of its parts, each from several "
        "seeds with equal updates, score all on equal episodes, and print the ablation table. Finished "
        "parts are kept: the same command resumes an interrupted run.",
    )
    parser.add_argument(
        "--data",
        metavar="DIR",
        type=Path,
        action="append",
        required=True,
        help="a folder of shards, or of such folders",
    )
    parser.add_argument(
        "--out", metavar="DIR", type=Path, required=True, help="gets one folder for each arm and seed"
    )
    parser.add_argument(
        "--arm",
        metavar="NAME",
        action="append",
        help="a variant to compare with the whole method (default: all that differ from it)",
    )
    parser.add_argument(
        "--seeds", metavar="N", type=int, default=3, help="seeds of each arm (default: %(default)s)"
    )
    add_settings(parser)
    parser.add_argument(
        "--condition",
        metavar="NAME",
        action="append",
        help="a condition to score under (default: field and hard)",
    )
    parser.add_argument(
        "--episodes", metavar="N", type=int, default=8, help="episodes per cell (default: %(default)s)"
    )
    parser.add_argument(
        "--steps", type=int, default=500, metavar="N", help="steps per episode (default: %(default)s)"
    )
    parser.add_argument(
        "--workers",
        metavar="N",
        type=int,
        default=len(os.sched_getaffinity(0)),
        help="processes (default: %(default)s)",
    )
    parser.add_argument("--latex", type=Path, metavar="FILE", help="write the paper's table here")
    parser.add_argument(
        "--json", action="store_true", help="print one JSON object as the only line of stdout"
    )
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Train and score every arm; return the exit status.

    Raises:
        UsageError: an unknown arm or condition, a number out of range, a missing extra, or a folder that
            holds another run.
        PlatformError: a worker process died.
    """
    try:
        from adatracker_deploy.learning.train.arms import ARMS, WHOLE, arms_of, of_arm, train_arm
    except ImportError as error:
        raise UsageError(f"training needs {error.name}: pip install 'adatracker-deploy[train]'") from error
    from adatracker_deploy.cli.counting import counted
    from adatracker_deploy.learning.conditions import condition_named
    from adatracker_deploy.learning.data.workers import in_processes

    for name in ("seeds", "workers", "episodes", "steps"):
        if (value := getattr(args, name)) < 1:
            raise UsageError(f"--{name}: {value} is out of range, at least 1")
    settings = settings_of(args, "ablate")
    different = arms_of(settings)
    for name in args.arm or ():
        if name not in ARMS:
            raise UsageError(f"--arm: unknown {name!r}; known are {', '.join(ARMS)}")
        if name not in different and name != WHOLE:
            raise UsageError(
                f"--arm {name}: leaves out nothing here that no other does: choose of {', '.join(different)}"
            )
    conditions = args.condition or ["field", "hard"]
    for name in conditions:
        condition_named(name)
    arms = list(dict.fromkeys([WHOLE, *(args.arm or different)]))
    # Seed by seed, so that a table of fewer seeds is ready first.
    places = [(arm, seed) for seed in range(args.seeds) for arm in arms]
    jobs = [(of_arm(settings, arm, seed), args.data, args.out / arm / f"seed-{seed}") for arm, seed in places]
    for _ in counted(in_processes(train_arm, jobs, args.workers), len(jobs), "runs"):
        pass
    bundles = {
        arm: [args.out / arm / f"seed-{seed}" / "bundle" for seed in range(args.seeds)] for arm in arms
    }
    scored = {name: _scored(args, name, bundles) for name in conditions}
    _show(args, scored)
    return 0


def _scored(args: argparse.Namespace, condition: str, bundles: dict[str, list[Path]]) -> list[ArmScore]:
    """Return every arm's score under a condition, all on equal episodes."""
    from adatracker_deploy.cli.counting import counted
    from adatracker_deploy.evaluation.ablation import ArmScore
    from adatracker_deploy.evaluation.grid import Grid
    from adatracker_deploy.evaluation.play import play_all
    from adatracker_deploy.evaluation.scores import PolicyScore

    policies = tuple(f"{path.resolve()}" for paths in bundles.values() for path in paths)
    grid = Grid(policies=policies, condition=condition, episodes=args.episodes, steps=args.steps)
    plan = grid.plan()
    with closing(play_all(plan, args.workers)) as playing:
        finished = [
            (plan[index], played) for index, played in counted(playing, len(plan), f"episodes of {condition}")
        ]
    return [
        ArmScore.of(
            arm,
            [
                PolicyScore.of(arm, [pair for pair in finished if pair[0].policy == str(path.resolve())])
                for path in paths
            ],
        )
        for arm, paths in bundles.items()
    ]


def _show(args: argparse.Namespace, scored: dict[str, list[ArmScore]]) -> None:
    """Print and write the tables."""
    from rich.console import Console

    from adatracker_deploy.evaluation.ablation import ablation_latex, ablation_record, ablation_table

    console = Console(stderr=args.json)
    for condition, arms in scored.items():
        console.print(ablation_table(condition, arms))
    if args.json:
        record = {condition: ablation_record(arms) for condition, arms in scored.items()}
        print(json.dumps(record, allow_nan=False))
    if args.latex is not None:
        try:
            args.latex.write_text(
                "\n".join(ablation_latex(condition, arms) for condition, arms in scored.items()), "utf-8"
            )
        except OSError as error:
            raise UsageError(f"{args.latex}: cannot be written: {error}") from error
