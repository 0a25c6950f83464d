"""``export``: a trial in the form of another program."""

from __future__ import annotations

import argparse
from pathlib import Path

from adatracker_deploy.core.errors import UsageError


def add_parser(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add ``export``."""
    parser = commands.add_parser(
        "export",
        help="write a trial for Rerun's viewer",
        description="Write a trial as a recording for Rerun's viewer: frames, masks, boxes, velocities, "
        "latencies and events on one time. Foxglove opens a trial's own trial.mcap.",
    )
    parser.add_argument("trial", metavar="TRIAL", type=Path, help="a trial's folder, or its trial.mcap")
    parser.add_argument("--out", metavar="FILE.rrd", type=Path, default=Path("trial.rrd"), help="%(default)s")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Write the recording; return the exit status.

    Raises:
        UsageError: it is not a trial, or has no ticks; the file is no .rrd or cannot be written; the SDK is
            not installed.
    """
    from adatracker_deploy.report.rerun_file import write_rerun
    from adatracker_deploy.trial.reader import read_trial

    if args.out.suffix != ".rrd":
        raise UsageError(f"--out {args.out}: expected a file that ends in .rrd")
    write_rerun(read_trial(args.trial), args.out)
    print(args.out)
    return 0
