"""``score``: trials scored again from their logs, plain box files, and folders of either."""

from __future__ import annotations

import argparse
import json
from pathlib import Path

from adatracker_deploy.cli.scoring import add_scoring_options, gather
from adatracker_deploy.core.errors import UsageError


def add_parser(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add ``score``."""
    parser = commands.add_parser(
        "score",
        help="score trials with the paper's metrics",
        description="Score trials again from their trial.mcap, or plain files of boxes: MR, EL and SR with "
        "95 % intervals, and AR where the truth is known. What cannot be scored gets a line on stderr.",
    )
    parser.add_argument(
        "paths",
        metavar="PATH",
        nargs="*",
        type=Path,
        help="trials, files of boxes (x,y,w,h a line, or MOT), or folders of either",
    )
    parser.add_argument(
        "--boxes", metavar="FILE", nargs="+", type=Path, help="files of boxes, whatever their names"
    )
    out = parser.add_argument_group("output")
    out.add_argument("--json", action="store_true", help="print one JSON object as the only line of stdout")
    out.add_argument("--csv", metavar="FILE", type=Path, help="write one line for each trial")
    out.add_argument("--latex", metavar="FILE", type=Path, help="write the paper's real-world table")
    out.add_argument(
        "--mlflow", metavar="URI", help="log the scores there, too: sqlite:///mlflow.db, http://HOST:PORT"
    )
    add_scoring_options(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Score what was named; return the exit status.

    Raises:
        UsageError: there is nothing to score, or a file cannot be written, or MLflow cannot be used there.
    """
    if (args.boxes is None) == (not args.paths):
        raise UsageError("name what to score: trials (score PATH...), or boxes (score --boxes FILE ...)")
    summaries = gather(args.boxes or args.paths, args, boxes=args.boxes is not None)

    from rich.console import Console

    from adatracker_deploy.scoring.csv_table import csv_table
    from adatracker_deploy.scoring.latex import real_world_table
    from adatracker_deploy.scoring.summary import summarise_set
    from adatracker_deploy.scoring.summary_table import summary_table

    if args.csv is not None:
        _write(args.csv, csv_table(summaries))
    if args.latex is not None:
        _write(args.latex, real_world_table(summaries))
    if args.mlflow:
        from adatracker_deploy.publishing.mlflow_trials import log_trials

        log_trials(args.mlflow, summaries)
    if args.json:
        print(json.dumps(summaries[0] if len(summaries) == 1 else summarise_set(summaries), allow_nan=False))
    else:
        Console().print(summary_table(summaries))
    return 0


def _write(path: Path, text: str) -> None:
    try:
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise UsageError(f"{path}: cannot be written ({error.strerror})") from error
