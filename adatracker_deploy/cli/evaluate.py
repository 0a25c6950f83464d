"""``evaluate``: policies over the paper's grid of bodies, or what a policy's context knows of a body."""

from __future__ import annotations

import argparse
import json
import os
import signal
import time
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING, NoReturn

from adatracker_deploy.core.errors import PlatformError, UsageError
from adatracker_deploy.policy.catalogue import DEFAULT, pinned

if TYPE_CHECKING:
    from collections.abc import Sequence

    from adatracker_deploy.evaluation.grid import Grid
    from adatracker_deploy.evaluation.play import Episode, Played


def add_parser(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add ``evaluate``."""
    parser = commands.add_parser(
        "evaluate",
        help="score policies over the paper's grid of bodies",
        description="Score policies over 4 camera heights and 4 target speeds, on equal episodes, with 95 % "
        "intervals and beside the paper's figures. When interrupted, it shows the finished part.",
    )
    parser.add_argument(
        "--policy",
        metavar="NAME|DIR|URI",
        action="append",
        help=f"the policy; repeat it to compare several (default: {DEFAULT})",
    )
    parser.add_argument(
        "--condition",
        default="clean",
        metavar="NAME",
        help="clean, field, hard, wide or rough (default: %(default)s)",
    )
    parser.add_argument(
        "--scene", default="simple_room", metavar="NAME", help="the virtual world (default: %(default)s)"
    )
    parser.add_argument(
        "--segmenter",
        default="truth",
        metavar="NAME|FILE",
        help="embedded, or a model's file: segment rendered pictures (default: the true masks)",
    )
    parser.add_argument(
        "--aspect",
        type=float,
        metavar="A",
        help="height of pictures and masks as a share of their width (default: 1, as the paper's; "
        "with a segmenter of pictures 0.75)",
    )
    parser.add_argument(
        "--episodes", type=int, default=20, metavar="N", help="episodes per cell (default: %(default)s)"
    )
    parser.add_argument(
        "--seed", type=int, default=0, metavar="S", help="seed of the run (default: %(default)s)"
    )
    parser.add_argument(
        "--steps", type=int, default=500, metavar="N", help="steps per episode (default: %(default)s)"
    )
    parser.add_argument(
        "--workers",
        type=int,
        default=len(os.sched_getaffinity(0)),
        metavar="N",
        help="processes (default: %(default)s)",
    )
    parser.add_argument("--latex", type=Path, metavar="FILE", help="write the paper's table here")
    parser.add_argument("--picture", type=Path, metavar="PNG", help="draw heat maps here")
    parser.add_argument(
        "--context",
        type=Path,
        metavar="PNG",
        help="instead of the grid: draw z of 16 x N bodies of a recipe, and how well it explains them",
    )
    parser.add_argument(
        "--recipe", metavar="NAME|FILE", help="with --context: what bodies are drawn from (default: deploy)"
    )
    parser.add_argument(
        "--swap", action="store_true", help="with --context: also measure the cost of another body's z"
    )
    parser.add_argument(
        "--json", action="store_true", help="print one JSON object as the only line of stdout"
    )
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Evaluate; return the exit status.

    Raises:
        UsageError: a policy, condition, scene or number is wrong, or a file cannot be written.
        PlatformError: a worker process died; what was finished has been shown.
    """
    if args.workers < 1:
        raise UsageError(f"--workers: {args.workers} is out of range, at least 1")
    for name in ("swap", "recipe"):
        if getattr(args, name) and args.context is None:
            raise UsageError(f"--{name} needs --context PNG")
    signal.signal(signal.SIGTERM, _interrupt)
    return _grid(args) if args.context is None else _context(args)


def _grid(args: argparse.Namespace) -> int:
    from adatracker_deploy.cli.counting import counted
    from adatracker_deploy.evaluation.grid import Grid, policy_labels
    from adatracker_deploy.evaluation.picture import check_drawing
    from adatracker_deploy.evaluation.play import play_all

    grid = Grid(
        policies=tuple(map(pinned, args.policy or [DEFAULT])),
        condition=args.condition,
        scene=args.scene,
        episodes=args.episodes,
        seed=args.seed,
        steps=args.steps,
        segmenter=args.segmenter,
        aspect=args.aspect,
    )
    labels = policy_labels(grid.policies)
    if args.picture is not None:
        check_drawing(args.picture)
    plan = grid.plan()
    begin_s = time.monotonic()
    finished: list[tuple[Episode, Played]] = []
    stopped: BaseException | None = None
    try:
        # Closed here and now: what is interrupted must not go on working while its results are shown.
        with closing(play_all(plan, args.workers)) as playing:
            for index, played in counted(playing, len(plan), "episodes"):
                finished.append((plan[index], played))
    except (KeyboardInterrupt, PlatformError) as reason:
        stopped = reason
    if finished:
        _show(args, grid, labels, finished, time.monotonic() - begin_s)
    if stopped is not None:
        raise stopped
    return 0


def _show(
    args: argparse.Namespace,
    grid: Grid,
    labels: dict[str, str],
    finished: Sequence[tuple[Episode, Played]],
    seconds: float,
) -> None:
    """Print and write what was played."""
    from rich.console import Console

    from adatracker_deploy.evaluation.latex import latex_table
    from adatracker_deploy.evaluation.picture import grid_picture, write_figure
    from adatracker_deploy.evaluation.record import grid_record
    from adatracker_deploy.evaluation.scores import PolicyScore, differences
    from adatracker_deploy.evaluation.table import grid_table

    by_policy = {label: [pair for pair in finished if pair[0].policy == key] for key, label in labels.items()}
    scores = [PolicyScore.of(label, pairs) for label, pairs in by_policy.items() if pairs]
    compared = differences(scores)
    Console(stderr=args.json).print(grid_table(grid, scores, compared))
    if args.json:
        print(json.dumps(grid_record(grid, scores, compared, seconds), allow_nan=False))
    if args.latex is not None:
        _write(args.latex, latex_table(grid, scores))
    if args.picture is not None:
        write_figure(grid_picture(grid, scores), args.picture)


def _context(args: argparse.Namespace) -> int:
    from rich.console import Console

    from adatracker_deploy.cli.counting import counted
    from adatracker_deploy.evaluation.context_study import RECIPE, study_context
    from adatracker_deploy.evaluation.context_view import context_picture, context_table
    from adatracker_deploy.evaluation.grid import CELLS, policy_labels
    from adatracker_deploy.evaluation.picture import check_drawing, write_figure
    from adatracker_deploy.evaluation.play import play_all

    policies = tuple(map(pinned, args.policy or [DEFAULT]))
    if len(policies) != 1:
        raise UsageError("--context studies one policy: name it with --policy")
    if args.latex is not None or args.picture is not None:
        raise UsageError("--latex and --picture show the grid, which --context replaces: drop them")
    check_drawing(args.context)
    ((policy, name),) = policy_labels(policies).items()
    study = study_context(
        policy,
        lambda episodes: counted(play_all(episodes, args.workers), len(episodes), "episodes"),
        bodies=len(CELLS) * args.episodes,
        recipe=args.recipe or RECIPE,
        seed=args.seed,
        steps=args.steps,
        swap=args.swap,
    )
    Console(stderr=args.json).print(context_table(name, study))
    write_figure(context_picture(name, study), args.context)
    if args.json:
        print(json.dumps({"policy": name, **study.record()}, allow_nan=False))
    return 0


def _write(path: Path, text: str) -> None:
    try:
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise UsageError(f"{path}: cannot be written ({error.strerror})") from error


def _interrupt(*_: object) -> NoReturn:
    raise KeyboardInterrupt
