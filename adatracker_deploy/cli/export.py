"""``export``: a trial in the form of another program."""

from __future__ import annotations

import argparse
from pathlib import Path

from adatracker_deploy.core.errors import UsageError

_RERUN = ".rrd"


def add_parser(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add ``export``."""
    parser = commands.add_parser(
        "export",
        help="write a trial for Rerun's viewer, or its CAN traffic for CAN tools",
        description="Write a trial as a recording for Rerun's viewer (.rrd): frames, masks, boxes, "
        "velocities, latencies and events on one time; or a base's CAN traffic as .asc or .blf. Foxglove "
        "opens a trial's own trial.mcap.",
    )
    parser.add_argument("trial", metavar="TRIAL", type=Path, help="a trial's folder, or its trial.mcap")
    parser.add_argument(
        "--out",
        metavar="FILE",
        type=Path,
        default=Path("trial.rrd"),
        help="its suffix chooses the format; default %(default)s",
    )
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Write the file; return the exit status.

    Raises:
        UsageError: it is not a trial, or has no ticks or no traffic; the file has another suffix or cannot be
            written; a library is not installed.
    """
    from adatracker_deploy.report.rerun_file import write_rerun
    from adatracker_deploy.trial.reader import read_trial

    if args.out.suffix == _RERUN:
        write_rerun(read_trial(args.trial), args.out)
    else:
        _write_traffic(args.trial, args.out)
    print(args.out)
    return 0


def _write_traffic(trial: Path, out: Path) -> None:
    """Write the traffic of a robot's wire, in the formats that its platform has."""
    from adatracker_deploy.registry import load_platform
    from adatracker_deploy.trial.reader import read_head, wall_offset_ns

    file, about = read_head(trial)
    platform = load_platform(about["platform"])
    if out.suffix not in platform.traffic_formats:
        suffixes = " or ".join((_RERUN, *platform.traffic_formats))
        raise UsageError(f"--out {out}: expected a file that ends in {suffixes}")
    platform.export_traffic(file.parent, out, wall_offset_ns(about) or 0)
