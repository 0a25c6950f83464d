"""Reads plain box files of trackers and data sets: one box per tick.

| a line                               | written by                                                 |
|--------------------------------------|------------------------------------------------------------|
| ``x,y,w,h``                          | LaSOT, OTB, GOT-10k; by commas, semicolons, blanks or tabs |
| ``frame,id,x,y,w,h[,conf[,...]]``    | MOTChallenge: 6, 7, 9 or 10 numbers                        |

Pixels, from the top left corner of the image. A first line of names (``x,y,w,h``) is passed over. Whether
pixels count from 0 or from 1 is the same to every score, which knows differences alone.
"""

from __future__ import annotations

import configparser
import math
import re
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.core.messages import Box

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

ABSENT_SUFFIX = ".absent.txt"
"""FILE.txt is read with FILE.absent.txt, where that lies beside it."""
_MOT_COLUMNS = (6, 7, 9, 10)
_USUAL_SIZES = (
    (320, 240),
    (480, 360),
    (640, 360),
    (640, 480),
    (768, 576),
    (960, 540),
    (1024, 768),
    (1280, 720),
    (1280, 960),
    (1920, 1080),
    (2560, 1440),
    (3840, 2160),
)
_SEPARATORS = re.compile(r"[,;\s]+")


@dataclass(frozen=True, slots=True, kw_only=True)
class BoxOptions:
    """The facts that a box file does not state itself."""

    image_size: tuple[int, int] | None = None
    """Width and height, px; None where a seqinfo.ini says it, or `usual_size` is to be taken."""
    absent: Path | None = None
    """A file of flags, 0 or 1 for each box: at 1 the target is not in sight."""
    target: int | None = None
    """Id of the boxes to score, in a MOT file with several ids."""
    rate_hz: float | None = None
    """Boxes a second; None where a seqinfo.ini says it, or nobody knows."""


@dataclass(frozen=True, slots=True)
class BoxTrack:
    """A target's boxes, one a tick; None where it is not seen."""

    boxes: tuple[Box | None, ...]
    """Normalised. An invalid box (NaN, a negative size) is kept as it stands, for scoring to count."""
    rate_hz: float | None
    assumed_size: tuple[int, int] | None = None
    """Width and height, px, where nobody said them and `usual_size` was taken."""


def read_boxes(path: Path, options: BoxOptions) -> BoxTrack:
    """Read a box file; lost is a width or height of 0, a 1 in the absent flags, a frame without the target.

    A MOT track begins at the target's first frame and ends with the sequence: its length in the seqinfo.ini
    beside the file or one folder up, or the last frame that the file has. Lines of confidence 0 are passed
    over, which is how MOTChallenge marks what is not to be considered.

    Raises:
        UsageError: a file cannot be read, is empty, or has a line that is something else; the target's id is
            not known; the flags are not as many as the boxes.
    """
    rows = _rows(path)
    info = _sequence_info(path)
    said = options.image_size or _size_of(info)
    size = said or usual_size(rows)
    if len(rows[0]) == 4:
        if options.target is not None:
            raise UsageError(f"{path}: --id is for MOT files, this one has x,y,w,h a line")
        pixels = _flagged(path, list(rows), options.absent)
    else:
        pixels = _mot_track(path, rows, options.target, info)
    boxes = tuple(None if row is None else _box(row, size) for row in pixels)
    return BoxTrack(boxes, options.rate_hz or _positive(info, "frameRate"), None if said else size)


def usual_size(rows: Sequence[tuple[float, ...]]) -> tuple[int, int]:
    """Return the smallest usual size of images, (width, height) px, that holds every box.

    (1, 1) for boxes in fractions; what the boxes themselves take up, where that is more than any usual size.

    Args:
        rows: numbers of lines, x, y, w, h or frame, id, x, y, w, h, ...
    """
    boxes = (row if len(row) == 4 else row[2:6] for row in rows)
    ends = [(x + w, y + h) for x, y, w, h in boxes if math.isfinite(x + y + w + h) and w > 0 and h > 0]
    width = max((x for x, _ in ends), default=1.0)
    height = max((y for _, y in ends), default=1.0)
    usual = ((1, 1), *_USUAL_SIZES, (math.ceil(width), math.ceil(height)))
    # Counted from 1, as some data sets do, a box may end a pixel further out.
    slack = 1 if max(width, height) > 2 else 0
    return next(size for size in usual if width <= size[0] + slack and height <= size[1] + slack)


def _rows(path: Path) -> list[tuple[float, ...]]:
    """Return the numbers of every line, all lines alike."""
    lines = _lines(path)
    named = re.fullmatch(
        r"(frame,id,)?x,y,(w,h|width,height).*", _SEPARATORS.sub(",", lines[0].strip().lower())
    )
    rows: list[tuple[float, ...]] = []
    for number, line in list(enumerate(lines, start=1))[1 if named else 0 :]:
        try:
            row = tuple(map(float, _SEPARATORS.sub(" ", line).split()))
        except ValueError:
            row = ()
        if len(row) not in (4, *_MOT_COLUMNS) or (rows and len(row) != len(rows[0])):
            wanted = f"the {len(rows[0])} numbers of before" if rows else "x,y,w,h or frame,id,x,y,w,h,..."
            raise UsageError(f"{path}: line {number}: expected {wanted}, got {line[:60]!r}")
        rows.append(row)
    if not rows:
        raise UsageError(f"{path}: has no boxes")
    return rows


def _lines(path: Path) -> list[str]:
    try:
        lines = path.read_text(encoding="utf-8-sig").rstrip().splitlines()
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "not a text file"
        raise UsageError(f"{path}: cannot be read as boxes ({reason})") from error
    if not lines:
        raise UsageError(f"{path}: is empty")
    return lines


def _flagged(
    path: Path, rows: list[tuple[float, ...]], absent: Path | None
) -> list[tuple[float, ...] | None]:
    beside = path.with_name(path.stem + ABSENT_SUFFIX)
    absent = absent or (beside if beside.is_file() else None)
    if absent is None:
        return list(rows)
    flags = [flag for line in _lines(absent) for flag in _SEPARATORS.split(line) if flag]
    if len(flags) != len(rows) or not set(flags) <= {"0", "1"}:
        raise UsageError(
            f"{absent}: expected {len(rows)} flags of 0 or 1, one for each box of {path}, found {len(flags)}"
        )
    return [None if flag == "1" else row for flag, row in zip(flags, rows, strict=True)]


def _mot_track(
    path: Path, rows: list[tuple[float, ...]], target: int | None, info: Mapping[str, str]
) -> list[tuple[float, ...] | None]:
    if not all(row[0].is_integer() and row[1].is_integer() and row[0] >= 0 for row in rows):
        raise UsageError(f"{path}: frames and ids must be whole numbers: frame,id,x,y,w,h,...")
    ids = sorted({int(row[1]) for row in rows})
    if target is None and len(ids) == 1:
        target = ids[0]
    if target not in ids:
        known = ", ".join(map(str, ids[:30])) + (", ..." if len(ids) > 30 else "")
        what = "has several targets" if target is None else f"has no target {target}"
        raise UsageError(f"{path}: {what}: choose one with --id, of {known}")
    track: dict[int, tuple[float, ...]] = {}
    for row in rows:
        if int(row[1]) != target or (len(row) > 6 and row[6] == 0):
            continue
        if row[0] in track:
            raise UsageError(f"{path}: target {target} has two boxes in frame {row[0]:.0f}")
        track[int(row[0])] = row[2:6]
    if not track:
        raise UsageError(f"{path}: target {target} has no box of a confidence above 0")
    length = _positive(info, "seqLength")
    last = max(int(max(row[0] for row in rows)), int(length or 0))
    return [track.get(frame) for frame in range(min(track), last + 1)]


def _sequence_info(path: Path) -> Mapping[str, str]:
    """Return the section of MOTChallenge's seqinfo.ini, empty where there is none."""
    for folder in (path.parent, path.parent.parent):
        file = folder / "seqinfo.ini"
        if file.is_file():
            parser = configparser.ConfigParser(interpolation=None)
            try:
                parser.read(file, encoding="utf-8")
                return parser["Sequence"]
            except (OSError, UnicodeDecodeError, KeyError, configparser.Error) as error:
                raise UsageError(f"{file}: not a seqinfo.ini of MOTChallenge") from error
    return {}


def _size_of(info: Mapping[str, str]) -> tuple[int, int] | None:
    width, height = _positive(info, "imWidth"), _positive(info, "imHeight")
    return (int(width), int(height)) if width and height else None


def _positive(info: Mapping[str, str], key: str) -> float | None:
    try:
        value = float(info.get(key, "nan"))
    except ValueError:
        return None
    return value if math.isfinite(value) and value > 0 else None


def _box(row: tuple[float, ...], image_size: tuple[int, int]) -> Box | None:
    x, y, w, h = row
    if w == 0 or h == 0:
        return None
    width, height = image_size
    return Box((x + w / 2) / width, (y + h / 2) / height, w / width, h / height)
