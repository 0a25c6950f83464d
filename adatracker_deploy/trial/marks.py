"""Operator annotations of a trial, in a separate file beside the unchanged log.

``trial.marks.yaml`` belongs to ``trial.mcap``, and to ``trial.mcap.part``, which becomes it. Marks are added,
none is changed: the last that names an outcome holds, and ``good`` takes the recorded one back.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Annotated, Any, Literal, get_args

import yaml

from adatracker_deploy.config.schema import Range, parse
from adatracker_deploy.core.errors import UsageError, line_of
from adatracker_deploy.trial.folder import sync_folder, write_file

if TYPE_CHECKING:
    from collections.abc import Iterable
    from pathlib import Path

    from adatracker_deploy.core.record import Outcome

MARKS_SUFFIX = ".marks.yaml"
Verdict = Literal["good", "takeover", "wrong_person", "collision"]
"""The verdicts of an operator on a trial's end: an outcome, or that the recorded one is right."""
VERDICTS: tuple[Verdict, ...] = get_args(Verdict)
LONGEST_NOTE = 2000
_SIZE_CAP_BYTES = 1 << 20
_HEAD = "# The operator's marks of this trial. The last outcome holds; good: the one that was recorded.\n"


@dataclass(frozen=True, slots=True, kw_only=True)
class Mark:
    """One thing said of a trial."""

    at: str
    """Time of the mark: UTC, ISO 8601."""
    outcome: Verdict | None = None
    """The trial's outcome; None for a note alone."""
    since_s: Annotated[float, Range(0, 1e6)] | None = None
    """Time of it, s of the run's clock from the first tick: it is scored up to there. None: at its end."""
    note: str = ""

    def __post_init__(self) -> None:
        if self.since_s is not None and self.outcome in (None, "good"):
            raise UsageError("a mark with a time needs an outcome: takeover, wrong_person or collision")
        if self.outcome is None and not self.note:
            raise UsageError("a mark needs an outcome, a note, or both")


@dataclass(frozen=True, slots=True, kw_only=True)
class _Document:
    marks: tuple[Mark, ...]


def marks_path(log: Path) -> Path:
    """Return where the marks of a log file are, finished or not."""
    return log.with_name(log.name.removesuffix(".part").removesuffix(".mcap") + MARKS_SUFFIX)


def read_marks(log: Path) -> tuple[Mark, ...]:
    """Return the marks of a log's trial, in their order; none without a file.

    Raises:
        UsageError: the file cannot be read, or does not hold marks.
    """
    path = marks_path(log)
    try:
        with path.open("rb") as file:
            data = file.read(_SIZE_CAP_BYTES + 1)
    except FileNotFoundError:
        return ()
    except OSError as error:
        raise UsageError(f"{path}: cannot be read ({error.strerror})") from error
    if len(data) > _SIZE_CAP_BYTES:
        raise UsageError(f"{path}: larger than 1 MiB, so not a marks file")
    try:
        document = yaml.safe_load(data)
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        raise UsageError(f"{path}: not valid YAML: {line_of(error)}") from error
    try:
        return parse(_Document, document, where=str(path)).marks
    except UsageError as error:
        told = str(error).removeprefix(f"{path}: ")  # what a mark itself refuses does not know its file
        raise UsageError(f"{path}: {told}") from error


def add_mark(log: Path, mark: Mark) -> tuple[Mark, ...]:
    """Add a mark to a log's, and see that it outlives a power cut; return them all.

    Raises:
        UsageError: the file there is not one of marks, or cannot be written; then it is unchanged.
    """
    marks = (*read_marks(log), mark)
    path = marks_path(log)
    text = yaml.safe_dump({"marks": [said(one) for one in marks]}, sort_keys=False, allow_unicode=True)
    try:
        write_file(path, _HEAD + text)
        sync_folder(path.parent)
    except OSError as error:
        raise UsageError(f"{path}: cannot be written ({error.strerror})") from error
    return marks


def holding(marks: Iterable[Mark]) -> tuple[Outcome, Mark] | None:
    """Return the outcome that holds instead of the recorded one, with its mark; None where none does."""
    held: tuple[Outcome, Mark] | None = None
    for mark in marks:
        if mark.outcome == "good":
            held = None
        elif mark.outcome is not None:
            held = (mark.outcome, mark)
    return held


def said(mark: Mark) -> dict[str, Any]:
    """Return a mark as plain values, without what it does not say."""
    return {name: value for name, value in asdict(mark).items() if value not in (None, "")}


def typed(text: str) -> str:
    """Return a note as one line that can be printed, cut to what a mark holds; the rest becomes blanks."""
    line = "".join(letter if letter.isprintable() else " " for letter in text)
    return line.strip()[:LONGEST_NOTE].strip()


def now_utc() -> str:
    """Return the wall-clock time as a mark has it."""
    return datetime.now(UTC).isoformat(timespec="seconds")
