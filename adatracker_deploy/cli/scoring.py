"""Shared by ``score`` and ``compare``: the options of scoring, and trials gathered from paths."""

from __future__ import annotations

import argparse
import math
import re
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from adatracker_deploy.core.errors import UsageError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from adatracker_deploy.scoring.box_file import BoxOptions
    from adatracker_deploy.scoring.metrics import Rules
    from adatracker_deploy.scoring.tally import Summary


def add_scoring_options(parser: argparse.ArgumentParser) -> None:
    """Add the rules of scoring, and the facts that box files do not state."""
    rules = parser.add_argument_group("how to score (the defaults are this toolkit's; docs/scoring.md)")
    rules.add_argument(
        "--lost-steps",
        metavar="N",
        type=_at_least_one,
        default=50,
        help="lost steps in a row that end a trial (default: 50, as in the paper; its simulator's code: 51)",
    )
    rules.add_argument(
        "--count-reference",
        action="store_true",
        help="MR as printed in the paper, summed from the reference on: a perfect trial exceeds 1",
    )
    rules.add_argument(
        "--least-reward",
        metavar="R",
        type=_finite,
        default=-math.inf,
        help="least reward of a step in AR (default: no floor, as the paper; its simulator's code: -1)",
    )
    rules.add_argument(
        "--drop-short",
        metavar="N",
        type=_at_least_one,
        help="leave out trials of N steps or fewer, as the published evaluation script does with 100; "
        "their number is printed (default: every trial counts)",
    )
    rules.add_argument(
        "--all",
        action="store_true",
        help="include trials whose timing was not kept in the means (default: they are listed and left out)",
    )
    boxes = parser.add_argument_group("plain files of boxes")
    boxes.add_argument(
        "--image-size",
        metavar="WxH",
        type=_image_size,
        help="size of the images, px (default: seqinfo.ini's, or the smallest usual size that holds them)",
    )
    boxes.add_argument(
        "--absent",
        metavar="FILE",
        type=Path,
        help="0 or 1 for each box: 1 is lost (default: FILE.absent.txt beside FILE.txt, if present)",
    )
    boxes.add_argument("--id", metavar="N", type=int, help="the target, in a MOT file of several")
    boxes.add_argument("--rate", metavar="HZ", type=_positive, help="boxes a second, for EL in seconds")


def gather(paths: Sequence[Path], args: argparse.Namespace, *, boxes: bool = False) -> list[Summary]:
    """Score everything that the paths name, once; bad ones get a line on stderr, and the others are scored.

    Args:
        paths: trials, box files, folders of either.
        args: with the options of `add_scoring_options`.
        boxes: these are box files, whatever their names.

    Raises:
        UsageError: nothing could be scored.
    """
    from adatracker_deploy.scoring.sources import find_box_files, find_sources, summarise_source
    from adatracker_deploy.trial.search import each_once

    rules, options = _rules(args), _box_options(args)
    summaries: list[Summary] = []
    errors: list[UsageError] = []
    seen: set[Path] = set()
    for path in _without_flags(paths):
        try:
            found = find_box_files(path) if boxes else find_sources(path)
        except UsageError as error:
            errors.append(error)
            continue
        if args.absent is not None and (len(found) > 1 or len(paths) > 1):
            raise UsageError("--absent is for one file of boxes; of several, each has its own beside it")
        for source in each_once(found, seen):
            try:
                summaries.append(summarise_source(source, rules, options, boxes=boxes))
            except UsageError as error:
                errors.append(error)
    if not summaries and len(errors) == 1:
        raise errors[0]
    for bad in errors:
        _say(f"left out: {bad}")
    kept = [row for row in summaries if args.drop_short is None or row["el"] > args.drop_short]
    if len(kept) < len(summaries):
        _say(f"left out: {len(summaries) - len(kept)} trials of {args.drop_short} steps or fewer")
    for row in kept:
        _remark(row, everything=args.all)
        row["counted"] = args.all or row.get("timing_kept", True)
    if not kept:
        raise UsageError("none of these could be scored")
    return kept


def _without_flags(paths: Sequence[Path]) -> list[Path]:
    """Return the paths less the flags of absence of others among them, as a shell's pattern gives both."""
    from adatracker_deploy.scoring.box_file import ABSENT_SUFFIX

    flags = {path.with_name(path.stem + ABSENT_SUFFIX) for path in paths}
    return [path for path in paths if path not in flags]


def _remark(row: Summary, *, everything: bool) -> None:
    from adatracker_deploy.scoring.summary import timing_words

    if row.get("assumed_size"):
        width, height = row["assumed_size"]
        _say(
            f"{row['trial']}: scored as of {width}x{height}, the smallest usual size that holds its boxes; "
            "correct it with --image-size"
        )
    if row["bad_boxes"]:
        _say(f"{row['trial']}: {row['bad_boxes']} boxes with NaN or a negative size, counted as lost")
    if not row.get("timing_kept", True):
        _say(
            f"{row['trial']}: {timing_words(row)}; "
            f"{'counted' if everything else 'left out of means: --all counts it'}"
        )
    if row.get("complete") is False:
        _say(f"{row['trial']}: the log was cut short, scored up to its last whole record")
    if row.get("recorded_outcome", row["outcome"]) != row["outcome"] and row["marks"]:
        _say(
            f"{row['trial']}: {row['outcome']} by the operator's mark, recorded as {row['recorded_outcome']}"
        )


def _say(line: str) -> None:
    print(f"adatracker-deploy: {line}", file=sys.stderr)


def _rules(args: argparse.Namespace) -> Rules:
    from adatracker_deploy.scoring.metrics import Rules

    return Rules(
        max_lost_steps=args.lost_steps,
        count_reference=args.count_reference,
        least_reward=args.least_reward,
    )


def _box_options(args: argparse.Namespace) -> BoxOptions:
    from adatracker_deploy.scoring.box_file import BoxOptions

    return BoxOptions(image_size=args.image_size, absent=args.absent, target=args.id, rate_hz=args.rate)


def _image_size(text: str) -> tuple[int, int]:
    match = re.fullmatch(r"([1-9]\d{0,4})[xX]([1-9]\d{0,4})", text)
    if match is None:
        raise argparse.ArgumentTypeError(
            f"expected WIDTHxHEIGHT in pixels, for example 1280x720, got {text!r}"
        )
    return int(match[1]), int(match[2])


def _at_least_one(text: str) -> int:
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"expected a whole number of at least 1, got {text!r}")
    return int(text)


def _finite(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise argparse.ArgumentTypeError(f"expected a number, got {text!r}")
    return value


def _positive(text: str) -> float:
    value = _finite(text)
    if value <= 0:
        raise argparse.ArgumentTypeError(f"expected a number above 0, got {text!r}")
    return value
