"""Index of trials, one row each: from the files beside a log if they suffice, else from the log."""

from __future__ import annotations

import contextlib
import fcntl
import json
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any

from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.scoring.summary import summarise_log
from adatracker_deploy.trial.folder import PART_NAME, SUMMARY_NAME
from adatracker_deploy.trial.marks import holding, read_marks
from adatracker_deploy.trial.reader import find_trials, read_head, read_scored, trial_file

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

COLUMNS = (
    "started", "platform", "kind", "policy", "outcome", "recorded_outcome", "mr", "el", "steps", "seconds",
    "bytes", "notes", "trial", "error", "timing_kept",
)  # fmt: skip
"""Keys of a row; what a trial does not have is None."""
_FROM_SUMMARY = ("mr", "el", "steps", "seconds")
_SUMMARY_CAP_BYTES = 1 << 20

Row = dict[str, Any]


def index(folder: Path) -> list[Row]:
    """Return a row for each trial in and below a folder, by the time at which it began.

    One that cannot be read has `error` and, for its time, its file's. One that is being written has neither
    an outcome nor figures.

    Raises:
        UsageError: there is no such folder, or no trial in it.
    """
    if not folder.is_dir():
        raise UsageError(f"{folder}: no such folder")
    return sorted(
        (_row(place) for place in find_trials(folder)), key=lambda row: (row["started"], row["trial"])
    )


def _row(place: Path) -> Row:
    row: Row = dict.fromkeys(COLUMNS) | {"trial": str(place), "notes": []}
    with contextlib.suppress(OSError):
        row["started"] = _utc(place.stat().st_mtime)
    try:
        file = trial_file(place)
        with contextlib.suppress(OSError):
            about = file.stat()
            row |= {"bytes": about.st_size, "started": _utc(about.st_mtime)}
        row |= _said(file)
    except UsageError as error:
        row["error"] = str(error)
    return row


def _said(file: Path) -> Row:
    """Return what a trial says of itself."""
    _, head = read_head(file)
    marks = read_marks(file)
    row: Row = {name: head.get(name) for name in ("platform", "kind", "policy")}
    row["notes"] = [mark.note for mark in marks if mark.note]
    if started := head.get("started"):
        row["started"] = _normal(started)
    if being_written(file):
        return row
    summary, held = _summary(file), holding(marks)
    found: Mapping[str, Any]
    if summary is None or (held is not None and held[1].since_s is not None):  # it is to be scored again
        found = summarise_log(read_scored(file))
        recorded, outcome = found["recorded_outcome"], found["outcome"]
    else:
        found, recorded = summary, summary["outcome"]
        outcome = recorded if held is None else held[0]
    return (
        row
        | {name: found[name] for name in _FROM_SUMMARY}
        | {
            "outcome": outcome,
            "recorded_outcome": recorded,
            "timing_kept": found.get("timing_kept"),
        }
    )


def being_written(file: Path) -> bool:
    """Return whether a log's writer is still at it: it holds a lock as long as it is."""
    if file.name != PART_NAME:
        return False
    with contextlib.suppress(FileNotFoundError), file.open("rb") as stream:  # it may be renamed by now
        try:
            fcntl.flock(stream, fcntl.LOCK_SH | fcntl.LOCK_NB)
        except BlockingIOError:
            return True
    return False


def _summary(file: Path) -> Mapping[str, Any] | None:
    """Read what the run left beside its log; None where that is not there, or says too little."""
    path = file.with_name(SUMMARY_NAME)
    try:
        if path.stat().st_size > _SUMMARY_CAP_BYTES:
            return None
        found = json.loads(path.read_bytes())
    except (OSError, ValueError):
        return None
    whole = isinstance(found, dict) and all(name in found for name in ("outcome", *_FROM_SUMMARY))
    return found if whole else None


def _normal(started: str) -> str:
    """Return a time as UTC to the second, or unchanged if it is not a time."""
    try:
        return _utc(datetime.fromisoformat(started).timestamp())
    except (ValueError, OverflowError):
        return started


def _utc(seconds: float) -> str:
    return datetime.fromtimestamp(seconds, UTC).isoformat(timespec="seconds")


def totals(rows: Sequence[Row]) -> str:
    """Say how many trials there are, how large, and how many cannot be read."""
    bad = sum(row["error"] is not None for row in rows)
    size_mb = sum(row["bytes"] or 0 for row in rows) / 1e6
    said = f"{len(rows)} trial{'' if len(rows) == 1 else 's'}, {size_mb:.1f} MB"
    return f"{said}; {bad} cannot be read" if bad else said
