"""``filmstrip``: a trial as one picture."""

from __future__ import annotations

import argparse
import json
from pathlib import Path

from adatracker_deploy.cli.ranges import whole
from adatracker_deploy.core.errors import UsageError


def add_parser(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add ``filmstrip``."""
    parser = commands.add_parser(
        "filmstrip",
        help="draw a trial as one picture",
        description="Draw evenly spaced frames of a trial with mask and box, above its curves over time.",
    )
    parser.add_argument("trial", metavar="TRIAL", type=Path, help="a trial's folder, or its trial.mcap")
    parser.add_argument(
        "--out",
        metavar="PNG",
        type=Path,
        default=Path("filmstrip.png"),
        help="the picture to write (default: %(default)s)",
    )
    parser.add_argument(
        "--frames", metavar="N", type=whole(1, 50), default=8, help="number of frames (default: %(default)s)"
    )
    parser.add_argument(
        "--json", action="store_true", help="print one JSON object as the only line of stdout"
    )
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Draw the picture; return the exit status.

    Raises:
        UsageError: it is not a trial, it has no frames, or the picture cannot be written.
    """
    import cv2

    from adatracker_deploy.report.filmstrip import film_strip
    from adatracker_deploy.trial.reader import read_trial

    strip = film_strip(read_trial(args.trial), args.frames)
    _, png = cv2.imencode(".png", cv2.cvtColor(strip, cv2.COLOR_RGB2BGR))
    try:
        args.out.write_bytes(png.tobytes())
    except OSError as error:
        raise UsageError(f"--out {args.out}: cannot be written ({error.strerror})") from error
    height, width = strip.shape[:2]
    print(
        json.dumps({"out": str(args.out), "width_px": width, "height_px": height}) if args.json else args.out
    )
    return 0
