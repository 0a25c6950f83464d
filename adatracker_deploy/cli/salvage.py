"""``salvage``: recover logs left unfinished by a kill or a power cut."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

from adatracker_deploy.core.errors import UsageError


def add_parser(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add ``salvage``."""
    parser = commands.add_parser(
        "salvage",
        help="recover unfinished logs",
        description="Turn an unfinished log (trial.mcap.part), left by a killed run or a power cut, into a "
        "proper trial.mcap. A run does this by itself for those in its --log-dir.",
    )
    parser.add_argument("path", metavar="PATH", type=Path, help="a trial.mcap.part, or a folder of trials")
    parser.add_argument(
        "--json", action="store_true", help="print one JSON object as the only line of stdout"
    )
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Salvage what was named; a log that cannot be costs a line on stderr, not the others.

    Raises:
        UsageError: there is no such log, or nothing could be salvaged.
    """
    from adatracker_deploy.trial.salvage import salvage, unfinished

    done, errors = [], []
    for part in unfinished(args.path):
        try:
            done.append(salvage(part))
        except UsageError as error:
            errors.append(error)
    if not done and len(errors) == 1:
        raise errors[0]
    for bad in errors:
        print(f"adatracker-deploy: left as it is: {bad}", file=sys.stderr)
    if errors and not done:
        raise UsageError("none of these could be salvaged")
    if args.json:
        logs = [{"path": str(log.path), "steps": log.steps, "lost_bytes": log.lost_bytes} for log in done]
        print(json.dumps({"salvaged": logs}))
    elif not done:
        print(f"{args.path}: nothing to salvage: no log here is unfinished")
    else:
        for log in done:
            print(f"{log.path}: {log.steps} steps, {log.lost_bytes} bytes behind them lost")
    return 0
