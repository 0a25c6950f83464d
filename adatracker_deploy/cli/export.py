"""``export``: trials in the form of another program."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from adatracker_deploy.core.errors import UsageError

_RERUN = ".rrd"


def add_parser(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add ``export``."""
    parser = commands.add_parser(
        "export",
        help="write trials for Rerun, ROS 2, LeRobot or CAN tools",
        description="Write a trial as a recording for Rerun's viewer (.rrd): frames, masks, boxes, "
        "velocities, latencies and events on one time; or a base's CAN traffic as .asc or .blf; or as a bag "
        "for ROS 2 (rosbag2). Or write trials as a LeRobotDataset. Foxglove opens a trial's own trial.mcap.",
    )
    parser.add_argument(
        "trial",
        metavar="TRIAL",
        type=Path,
        nargs="+",
        help="a trial's folder, or its trial.mcap; with --lerobot more than one, and folders of them",
    )
    to = parser.add_mutually_exclusive_group()
    to.add_argument(
        "--out",
        metavar="FILE",
        type=Path,
        default=Path("trial.rrd"),
        help="its suffix chooses the format; (default: %(default)s)",
    )
    to.add_argument("--lerobot", metavar="DIR", type=Path, help="a new folder for a LeRobotDataset v3.0")
    to.add_argument("--rosbag2", metavar="DIR", type=Path, help="a new folder for a bag of one trial")
    parser.add_argument(
        "--task", metavar="TEXT", help="what the robot was to do, for --lerobot (default: Follow the person.)"
    )
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Write the file or folder; return the exit status.

    Raises:
        UsageError: it is not a trial, or has no ticks or no traffic; the file has another suffix or cannot be
            written; a library is not installed.
        PlatformError: a video cannot be finished.
    """
    from adatracker_deploy.report.rerun_file import write_rerun
    from adatracker_deploy.trial.reader import read_trial

    if args.lerobot is not None:
        return _write_lerobot(args.trial, args.lerobot, args.task)
    if args.task is not None:
        raise UsageError("--task: goes with --lerobot")
    out = args.rosbag2 or args.out
    if len(args.trial) > 1:
        option = "--rosbag2" if args.rosbag2 else "--out"
        raise UsageError(f"{option} {out}: takes one trial, got {len(args.trial)}")
    (trial,) = args.trial
    if args.rosbag2 is not None:
        from adatracker_deploy.report.rosbag2.write import write_bag

        count = write_bag(read_trial(trial), out)
        print(f"{count} messages", file=sys.stderr)
    elif args.out.suffix == _RERUN:
        write_rerun(read_trial(trial), args.out)
    else:
        _write_traffic(trial, args.out)
    print(out)
    return 0


def _write_lerobot(paths: list[Path], out: Path, task: str | None) -> int:
    from adatracker_deploy.report.lerobot.write import TASK, write_lerobot
    from adatracker_deploy.trial.reader import find_trials, read_trial
    from adatracker_deploy.trial.search import each_once

    if task is not None and not (task.strip() and task.isprintable()):
        raise UsageError("--task: expected a line of words")
    found = each_once((trial for path in paths for trial in find_trials(path)), set())
    trials = [read_trial(trial) for trial in found]
    written = write_lerobot(trials, out, task or TASK)
    print(
        f"{written.trials} of {len(trials)} trials: {written.episodes} episodes, {written.rows} rows; "
        f"{written.left_out} ticks at ends and gaps left out",
        file=sys.stderr,
    )
    print(out)
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
