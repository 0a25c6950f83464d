"""``collect``: training data, by a recipe."""

from __future__ import annotations

import argparse
import json
import os
import time
from pathlib import Path

from adatracker_deploy.cli.counting import Count
from adatracker_deploy.cli.extras import need
from adatracker_deploy.core.errors import UsageError


def add_parser(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add ``collect``."""
    parser = commands.add_parser(
        "collect",
        help="collect training data",
        description="Collect episodes of a perturbed expert by a recipe; the same command resumes "
        "an interrupted run.",
    )
    parser.add_argument(
        "--recipe", metavar="NAME|FILE", default="deploy", help="the data's recipe (default: %(default)s)"
    )
    parser.add_argument("--out", metavar="DIR", type=Path, required=True, help="the folder for its shards")
    parser.add_argument("--steps", metavar="N", type=int, help="number of steps (default: the recipe's)")
    parser.add_argument(
        "--workers",
        metavar="N",
        type=int,
        default=len(os.sched_getaffinity(0)),
        help="processes (default: %(default)s)",
    )
    parser.add_argument(
        "--ray",
        metavar="ADDRESS",
        nargs="?",
        const="auto",
        help="use a Ray cluster instead: HOST:PORT or local (default: the one on this machine)",
    )
    parser.add_argument(
        "--seed", metavar="S", type=int, default=0, help="seed of the run (default: %(default)s)"
    )
    parser.add_argument(
        "--json", action="store_true", help="print one JSON object as the only line of stdout"
    )
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Collect; return the exit status.

    Raises:
        UsageError: no such recipe, a number out of range, or a folder that holds something else.
    """
    from adatracker_deploy.core.camera import is_unreal
    from adatracker_deploy.learning.data.collect import collect
    from adatracker_deploy.learning.data.recipe import load_recipe

    for name, least in (("steps", 1), ("workers", 1), ("seed", 0)):
        value = getattr(args, name)
        if value is not None and value < least:
            raise UsageError(f"--{name}: {value} is out of range, at least {least}")
    recipe = load_recipe(args.recipe)
    world = [] if all(map(is_unreal, recipe.scenes)) else ["world"]
    need([*world, *(["ray"] if args.ray else ())], "collect")
    steps = args.steps or recipe.steps
    begin_s = time.monotonic()
    with Count("steps") as count:
        collect(
            recipe,
            args.out,
            steps=steps,
            seed=args.seed,
            workers=args.workers,
            ray=args.ray,
            progress=count,
        )
    if args.json:
        taken_s = round(time.monotonic() - begin_s, 1)
        print(json.dumps({"out": str(args.out), "recipe": recipe.name, "steps": steps, "taken_s": taken_s}))
    else:
        print(args.out)
    return 0
