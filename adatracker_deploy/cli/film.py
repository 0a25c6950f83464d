"""``film``: a trial as a film."""

from __future__ import annotations

import argparse
import contextlib
import json
from pathlib import Path

from adatracker_deploy.core.errors import UsageError


def add_parser(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add ``film``."""
    parser = commands.add_parser(
        "film",
        help="draw a trial as a film",
        description="Draw every tick of a trial as an MP4: the frame with mask, box and state of the target, "
        "and the command sent to the robot.",
    )
    parser.add_argument("trial", metavar="TRIAL", type=Path, help="a trial's folder, or its trial.mcap")
    parser.add_argument(
        "--out",
        metavar="FILE.mp4",
        type=Path,
        default=Path("trial.mp4"),
        help="the film to write (default: %(default)s)",
    )
    parser.add_argument(
        "--json", action="store_true", help="print one JSON object as the only line of stdout"
    )
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Write the film; return the exit status.

    Raises:
        UsageError: it is not a trial, it has no frames, or the film cannot be written.
        PlatformError: the film cannot be finished.
    """
    from adatracker_deploy.perception.film_writer import FilmWriter, check_film_path
    from adatracker_deploy.report.film import film_rate_hz, shots
    from adatracker_deploy.trial.reader import read_trial

    try:
        check_film_path(args.out)
    except UsageError as error:
        raise UsageError(f"--out {error}") from error
    trial = read_trial(args.trial)
    rate_hz = film_rate_hz(trial)
    with contextlib.closing(FilmWriter(args.out, rate_hz)) as film:
        for shot in shots(trial):
            film.write(shot.picture, shot.t_ns)
    if args.json:
        print(json.dumps({"out": str(args.out), "frames": film.frames, "rate_hz": round(rate_hz, 3)}))
    else:
        print(args.out)
    return 0
