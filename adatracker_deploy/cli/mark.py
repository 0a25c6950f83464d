"""``mark``: what the operator says of a trial, afterwards."""

from __future__ import annotations

import argparse
import json
import math
from pathlib import Path

from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.trial.marks import LONGEST_NOTE, VERDICTS


def add_parser(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add ``mark``."""
    parser = commands.add_parser(
        "mark",
        help="record how a trial really ended, or add a note",
        description="Record what the log cannot know: that the robot was taken over by hand, followed a "
        "wrong person, touched something, or that all was well. The mark is written beside the log, which "
        "stays as it is; score, compare, report and trials use it.",
    )
    parser.add_argument("trial", metavar="TRIAL", type=Path, help="a trial's folder, or its trial.mcap")
    parser.add_argument(
        "--outcome",
        choices=VERDICTS,
        help="how it ended; good: as recorded, whatever was marked before",
    )
    parser.add_argument(
        "--since",
        type=float,
        metavar="S",
        help="its time, seconds from the first tick: the trial is scored up to there (default: its end)",
    )
    parser.add_argument("--note", default="", metavar="TEXT", help="a note in words")
    parser.add_argument(
        "--json", action="store_true", help="print one JSON object as the only line of stdout"
    )
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Add the mark; return the exit status.

    Raises:
        UsageError: it is not a trial, or the mark is empty, too long or outside the trial's time.
    """
    from adatracker_deploy.scoring.index import being_written
    from adatracker_deploy.scoring.summary import summarise_log
    from adatracker_deploy.scoring.summary_table import takeover_text
    from adatracker_deploy.trial.marks import Mark, add_mark, marks_path, now_utc, typed
    from adatracker_deploy.trial.reader import read_scored

    if len(args.note) > LONGEST_NOTE:
        raise UsageError(f"--note: at most {LONGEST_NOTE} characters")
    trial = read_scored(args.trial)
    if being_written(trial.path):
        raise UsageError(f"{trial.path}: still being written; mark it when its run has ended")
    lasted_s = (trial.steps[-1].t_ns - trial.steps[0].t_ns) / 1e9 if trial.steps else 0.0
    if args.since is not None and not (math.isfinite(args.since) and 0 <= args.since <= lasted_s):
        raise UsageError(f"--since {args.since:g}: the trial lasted from 0 to {lasted_s:.1f} s")
    mark = Mark(at=now_utc(), outcome=args.outcome, since_s=args.since, note=typed(args.note))
    add_mark(trial.path, mark)
    found = summarise_log(read_scored(trial.path))
    if args.json:
        shown = ("trial", "outcome", "marks", "takeovers")
        print(json.dumps({key: found[key] for key in shown}))
    else:
        taken = found["takeovers"]
        driven = f"; {takeover_text(taken)}" if taken["by_hand"] else ""
        print(
            f"{marks_path(trial.path)}: {found['outcome']}, recorded as {found['recorded_outcome']}{driven}"
        )
    return 0
