"""Plain box files: one ``x,y,w,h`` a line in pixels from the top left, as LaSOT and OTB write them."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from adatracker_deploy.errors import UsageError
from adatracker_deploy.messages import Box

if TYPE_CHECKING:
    from pathlib import Path


def read_boxes(path: Path, image_size: tuple[int, int], absent: Path | None = None) -> list[Box | None]:
    """Read one box a tick, normalised; None where the target is lost.

    Lost is a line whose numbers are NaN or whose width or height is not positive, and a 1 in `absent`.

    Args:
        path: four numbers a line, separated by commas, blanks or tabs.
        image_size: width and height, px.
        absent: a file of 0 and 1, one a line or separated by commas; as long as the boxes.

    Raises:
        UsageError: a file cannot be read, is empty, or has a line that is something else.
    """
    lines = _lines(path)
    boxes = [_box(line, image_size, f"{path}: line {number}") for number, line in enumerate(lines, start=1)]
    if absent is None:
        return boxes
    flags = [flag for line in _lines(absent) for flag in line.replace(",", " ").split()]
    if len(flags) != len(boxes) or not set(flags) <= {"0", "1"}:
        raise UsageError(f"{absent}: expected {len(boxes)} flags of 0 or 1, one for each box of {path}")
    return [None if flag == "1" else box for flag, box in zip(flags, boxes, strict=True)]


def _lines(path: Path) -> list[str]:
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "not a text file"
        raise UsageError(f"{path}: cannot be read ({reason})") from error
    if not any(line.strip() for line in lines):
        raise UsageError(f"{path}: is empty")
    return lines


def _box(line: str, image_size: tuple[int, int], where: str) -> Box | None:
    try:
        x, y, w, h = map(float, line.replace(",", " ").split())
    except ValueError as error:
        raise UsageError(f"{where}: expected x,y,w,h, got {line!r}") from error
    if not all(map(math.isfinite, (x, y, w, h))) or w <= 0 or h <= 0:
        return None
    width, height = image_size
    return Box((x + w / 2) / width, (y + h / 2) / height, w / width, h / height)
