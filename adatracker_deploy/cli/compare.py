"""``compare``: two sets of trials side by side, with intervals and exact tests."""

from __future__ import annotations

import argparse
import json
from pathlib import Path

from adatracker_deploy.cli.scoring import add_scoring_options, gather


def add_parser(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add ``compare``."""
    parser = commands.add_parser(
        "compare",
        help="compare two sets of trials, with intervals and exact tests",
        description="Compare B's trials with A's in MR, EL and SR, with 95 % intervals, exact tests and a "
        "conclusion in words; it says so where the trials are too few for one.",
    )
    for name in ("A", "B"):
        parser.add_argument(
            name.lower(), metavar=name, type=Path, help="a trial, a file of boxes, or a folder of either"
        )
    parser.add_argument(
        "--pairs",
        choices=("auto", "order", "none"),
        default="auto",
        help="trials to compare pair by pair: those of equal seed, scene, target speed and platform, if all "
        "have their partners (auto, the default); the first with the first and so on, as planned in the "
        "field (order); or none",
    )
    parser.add_argument(
        "--any-rate",
        action="store_true",
        help="no longer needed: trials of any rates are compared",
    )
    parser.add_argument(
        "--json", action="store_true", help="print one JSON object as the only line of stdout"
    )
    add_scoring_options(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Compare; return the exit status.

    Raises:
        UsageError: a side has nothing to score, or the two cannot be compared.
    """
    ours, theirs = gather([args.a], args), gather([args.b], args)

    from rich.console import Console

    from adatracker_deploy.scoring.compare import compare
    from adatracker_deploy.scoring.compare_view import comparison_record, comparison_table

    found = compare(ours, theirs, pairing=args.pairs)
    if args.json:
        print(json.dumps(comparison_record(found, ours, theirs), allow_nan=False))
    else:
        Console().print(comparison_table(found, ours, theirs))
    return 0
