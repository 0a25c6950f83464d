"""``score``: trials scored again from their logs, and plain box files."""

from __future__ import annotations

import argparse
import json
import re
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from adatracker_deploy.errors import UsageError

if TYPE_CHECKING:
    from collections.abc import Sequence


def add_parser(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add ``score``."""
    parser = commands.add_parser(
        "score",
        help="score trials with the paper's metrics",
        description="Score trials again from their trial.mcap, or score a plain file of boxes.",
    )
    parser.add_argument("paths", metavar="PATH", nargs="*", type=Path, help="trials, or folders of trials")
    parser.add_argument("--boxes", metavar="FILE", type=Path, help="x,y,w,h a line in pixels, one a tick")
    parser.add_argument("--image-size", metavar="WxH", type=_image_size, help="of the boxes' images, px")
    parser.add_argument("--absent", metavar="FILE", type=Path, help="0 or 1 for each box: 1 is lost")
    parser.add_argument("--json", action="store_true", help="one JSON object as the only line of stdout")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Score what was named; return the exit status.

    Raises:
        UsageError: there is nothing to score.
    """
    if args.boxes is None and (args.image_size or args.absent):
        raise UsageError("--image-size and --absent belong to --boxes FILE")
    if (args.boxes is None) == (not args.paths):
        raise UsageError("say what to score: trials (score PATH...), or boxes (score --boxes FILE ...)")
    summaries = [_boxes(args)] if args.boxes else _trials(args.paths)
    _show(summaries, as_json=args.json)
    return 0


def _trials(paths: Sequence[Path]) -> list[dict[str, Any]]:
    """Score every trial; a bad one costs a line on stderr, not the others."""
    from adatracker_deploy.trial.reader import find_trials, read_trial
    from adatracker_deploy.trial.summary import summarise_log

    summaries: list[dict[str, Any]] = []
    errors: list[UsageError] = []
    for path in paths:
        try:
            found = find_trials(path)
        except UsageError as error:
            errors.append(error)
            continue
        for trial in found:
            try:
                summaries.append(summarise_log(read_trial(trial)))
            except UsageError as error:
                errors.append(error)
    if not summaries and len(errors) == 1:
        raise errors[0]
    for bad in errors:
        print(f"adatracker-deploy: left out: {bad}", file=sys.stderr)
    if not summaries:
        raise UsageError("none of these could be scored")
    return summaries


def _boxes(args: argparse.Namespace) -> dict[str, Any]:
    from adatracker_deploy.trial.box_file import read_boxes
    from adatracker_deploy.trial.summary import summarise_boxes

    if args.image_size is None:
        raise UsageError("--boxes needs --image-size WxH, for example 1280x720: scores use normalised boxes")
    return summarise_boxes(read_boxes(args.boxes, args.image_size, args.absent), args.boxes)


def _show(summaries: Sequence[dict[str, Any]], *, as_json: bool) -> None:
    from rich.console import Console

    from adatracker_deploy.trial.summary import summarise_set, summary_table

    if as_json:
        print(json.dumps(summaries[0] if len(summaries) == 1 else summarise_set(summaries), allow_nan=False))
    else:
        Console().print(summary_table(summaries))


def _image_size(text: str) -> tuple[int, int]:
    match = re.fullmatch(r"([1-9]\d{0,4})[xX]([1-9]\d{0,4})", text)
    if match is None:
        raise argparse.ArgumentTypeError(
            f"expected WIDTHxHEIGHT in pixels, for example 1280x720, got {text!r}"
        )
    return int(match[1]), int(match[2])
