"""Reads a trial's log; a truncated one (a kill, a full disk) up to its last complete record."""

from __future__ import annotations

import contextlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO, NamedTuple, TypeVar

import yaml
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from foxglove_schemas_protobuf.Log_pb2 import Log
from google.protobuf.message import DecodeError
from mcap.exceptions import McapError
from mcap.records import Footer, Metadata
from mcap.writer import MCAP0_MAGIC

from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.core.mask_png import decode_mask
from adatracker_deploy.perception.jpeg import decode_jpeg
from adatracker_deploy.trial.folder import FILE_NAME, PART_NAME
from adatracker_deploy.trial.marks import Mark, read_marks
from adatracker_deploy.trial.older import as_of_format_2
from adatracker_deploy.trial.scan import whole_records
from adatracker_deploy.trial.search import search
from adatracker_deploy.trial.step_json import (
    OLDEST_FORMAT,
    STEP_FORMAT,
    scored_step_from_json,
    step_from_json,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Container, Iterator

    import numpy as np
    from numpy.typing import NDArray

    from adatracker_deploy.core.messages import ClassMask
    from adatracker_deploy.core.record import ScoredStep, StepRecord

_YamlLoader: type[yaml.SafeLoader] = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
"""The same, ten times as fast where PyYAML was built with libyaml."""
StepT = TypeVar("StepT", "StepRecord", "ScoredStep")


class LoggedEvent(NamedTuple):
    """A line of the log; wall-clock time, ns."""

    wall_ns: int
    level: str
    message: str


class LoggedMessage(NamedTuple):
    """A message as it is in the log; wall-clock time, ns."""

    topic: str
    wall_ns: int
    sequence: int
    data: bytes


class LoggedFrame(NamedTuple):
    """A camera frame: RGB uint8 (H, W, 3), class mask, uint8 of the mask's own size, and the JPEG it was."""

    seq: int
    rgb: NDArray[np.uint8]
    mask: ClassMask
    jpeg: bytes


class LoggedMask(NamedTuple):
    """A frame's class mask alone, uint8 of the mask's own size."""

    seq: int
    mask: ClassMask


@dataclass(frozen=True, slots=True, kw_only=True)
class TrialAbout:
    """The facts about a trial in its log, apart from its ticks."""

    path: Path
    """The file that was read."""
    platform: str
    kind: str
    policy: str
    planned_steps: int
    config: Mapping[str, Any]
    summary: Mapping[str, Any] | None
    """As the run wrote it; None when the run was cut short."""
    events: tuple[LoggedEvent, ...]
    complete: bool
    """The file has its end; a truncated one was read up to its last whole record."""
    about: Mapping[str, str]
    """Time and versions of its recording."""
    frame_seqs: frozenset[int]
    """Sequence numbers of the frames in the log."""
    marks: tuple[Mark, ...] = ()
    """The operator's marks, in their order."""

    @property
    def frames_kept(self) -> str:
        """The camera's pictures that the run kept (`privacy.Frames`)."""
        return str(self.config.get("frames", "full")) if isinstance(self.config, Mapping) else "full"

    @property
    def wall_offset_ns(self) -> int | None:
        """Offset of wall-clock time from the run's clock, ns; None where the log does not say."""
        return wall_offset_ns(self.about)


@dataclass(frozen=True, slots=True, kw_only=True)
class ScoredTrial(TrialAbout):
    """A trial with as much of its ticks as scoring needs."""

    steps: tuple[ScoredStep, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Trial(TrialAbout):
    """A trial as it was logged, without its frames."""

    steps: tuple[StepRecord, ...]

    def messages(self, topics: Container[str]) -> Iterator[LoggedMessage]:
        """Read the messages on these topics, in the order in which they were written, one at a time.

        Raises:
            UsageError: the file cannot be read any more.
        """
        for topic, record in _records(self.path, lambda topic, _: topic in topics):
            if topic and topic in topics:
                yield LoggedMessage(topic, record.log_time, record.sequence, record.data)

    def frames(self, wanted: Container[int] | None = None) -> Iterator[LoggedFrame]:
        """Read the frames whose sequence number is wanted (by default all), in order, one at a time.

        A damaged frame is left out.
        """
        jpeg = b""

        def is_wanted(topic: str, seq: int) -> bool:
            return topic in ("/camera", "/mask") and (wanted is None or seq in wanted)

        for topic, record in _records(self.path, is_wanted):
            if not topic or not is_wanted(topic, record.sequence):
                continue
            if topic == "/camera":  # its mask is the next record
                jpeg = record.data
                continue
            with contextlib.suppress(DecodeError, ValueError):
                yield _frame(record.sequence, jpeg, record.data)

    def ticks_with_frames(self) -> Iterator[tuple[StepRecord, LoggedFrame]]:
        """Walk through the ticks with the frame that each acted on; without those whose frame the log lacks.

        The numbers of both only grow.
        """
        frames = self.frames({step.frame_seq for step in self.steps})
        frame = next(frames, None)
        for step in self.steps:
            while frame is not None and frame.seq < step.frame_seq:
                frame = next(frames, None)
            if frame is None:
                return
            if frame.seq == step.frame_seq:
                yield step, frame

    def masks(self) -> Iterator[LoggedMask]:
        """Read every frame's mask, in order, one at a time; a damaged one is left out.

        Raises:
            UsageError: the file cannot be read any more.
        """
        for topic, record in _records(self.path, lambda topic, _: topic == "/mask"):
            if topic == "/mask":
                with contextlib.suppress(DecodeError, ValueError):
                    yield LoggedMask(
                        record.sequence, decode_mask(CompressedImage.FromString(record.data).data)
                    )


def read_trial(path: Path) -> Trial:
    """Read a trial's folder, or its ``trial.mcap`` or ``trial.mcap.part``.

    Raises:
        UsageError: nothing is there, or it is not a trial of this toolkit.
    """
    about, steps = _read(path, step_from_json)
    return Trial(steps=steps, **about)


def read_scored(path: Path) -> ScoredTrial:
    """Read as much of a trial as scoring needs, ten times as fast.

    Raises:
        UsageError: as `read_trial`.
    """
    about, steps = _read(path, scored_step_from_json)
    return ScoredTrial(steps=steps, **about)


def read_head(path: Path) -> tuple[Path, Mapping[str, str]]:
    """Read only which file a trial is in, and what its log says of it at its very beginning.

    Raises:
        UsageError: as `read_trial`.
    """
    file = trial_file(path)
    for _, record in _records(file, lambda *_: False):
        if isinstance(record, Metadata) and record.name == "trial":
            try:
                _check_format(file, record.metadata)
            except (KeyError, ValueError) as error:
                raise UsageError(f"{file}: not a trial of this toolkit ({_one_line(error)})") from error
            return file, record.metadata
    raise UsageError(f"{file}: not a trial of this toolkit (it does not name its trial)")


def wall_offset_ns(about: Mapping[str, str]) -> int | None:
    """Return what wall-clock time, ns, is ahead of the run's clock, by a log's head; None if unknown."""
    try:
        started_s = datetime.fromisoformat(about["started"]).timestamp()
        return round(started_s * 1e6) * 1000 - int(about["run_clock_ns"])
    except (KeyError, ValueError):
        return None


def _read(path: Path, decode: Callable[[bytes], StepT]) -> tuple[dict[str, Any], tuple[StepT, ...]]:
    """Read what `TrialAbout` holds, and the ticks in order."""
    file = trial_file(path)
    metadata: dict[str, Mapping[str, str]] = {}
    steps: list[StepT] = []
    events: list[LoggedEvent] = []
    frame_seqs: set[int] = set()
    complete = False
    try:
        for topic, record in _records(file, lambda topic, _: topic in ("/step", "/log")):
            if topic == "/step":
                steps.append(decode(record.data))
            elif topic == "/log":
                line = Log.FromString(record.data)
                events.append(LoggedEvent(record.log_time, Log.Level.Name(line.level).lower(), line.message))
            elif topic == "/camera":
                frame_seqs.add(record.sequence)
            elif isinstance(record, Metadata):
                metadata[record.name] = record.metadata
            elif isinstance(record, Footer):
                complete = True
        trial = metadata["trial"]
        _check_format(file, trial)
        about = {
            "path": file,
            "platform": trial["platform"],
            "kind": trial["kind"],
            "policy": trial["policy"],
            "planned_steps": int(trial["steps"]),
            "config": yaml.load(metadata["config"]["yaml"], Loader=_YamlLoader),
            "summary": json.loads(metadata["summary"]["json"]) if "summary" in metadata else None,
            "events": tuple(events),
            "complete": complete,
            "about": trial,
            "frame_seqs": frozenset(frame_seqs),
            "marks": read_marks(file),
        }
    except (KeyError, TypeError, ValueError, RecursionError, DecodeError, yaml.YAMLError) as error:
        raise UsageError(f"{file}: not a trial of this toolkit ({_one_line(error)})") from error
    ordered = sorted(steps, key=lambda step: step.step)
    return about, tuple(ordered if int(trial["step_format"]) >= 2 else as_of_format_2(ordered))


def _check_format(file: Path, trial: Mapping[str, str]) -> None:
    found = int(trial["step_format"])
    if found > STEP_FORMAT:
        raise UsageError(f"{file}: written by a newer version of this toolkit; update adatracker-deploy")
    if found < OLDEST_FORMAT:
        writer = trial.get("adatracker-deploy", "unknown")
        raise UsageError(
            f"{file}: written by an older version of this toolkit, in step format {found}, which this one "
            f"does not read: score it with adatracker-deploy {writer}"
        )


def find_trials(path: Path) -> list[Path]:
    """Return the trials that a path names: itself, or those in the folders below it, sorted.

    Folders that may not be read are among them: reading them says so.

    Raises:
        UsageError: there is none.
    """
    if not path.is_dir():
        return [path]
    found = search(path, {FILE_NAME, PART_NAME}.__contains__)
    if not (found.files or found.refused):
        raise UsageError(f"{path}: no trials in it: no folder here has a {FILE_NAME}")
    return sorted({*(file.parent for file in found.files), *found.refused})


def trial_file(path: Path) -> Path:
    """Return the file of a trial's folder, finished or not, or the file that is named itself.

    Raises:
        UsageError: there is none.
    """
    try:
        # the second look at the first: its writer may have finished it in between
        candidates = [path / FILE_NAME, path / PART_NAME, path / FILE_NAME] if path.is_dir() else [path]
        for candidate in candidates:
            if candidate.is_file():
                return candidate
    except PermissionError as error:
        raise UsageError(f"{path}: may not be read ({error.strerror})") from error
    missing = f"no {FILE_NAME} in it" if path.is_dir() else "no such file or folder"
    raise UsageError(f"{path}: {missing}")


def _records(path: Path, wanted: Callable[[str, int], bool]) -> Iterator[tuple[str, Any]]:
    """Give each record with its topic, up to the last whole one; data of messages only where they are wanted.

    Raises:
        UsageError: the file cannot be read, or is not MCAP.
    """
    try:
        with _opened(path) as stream:
            if stream.read(len(MCAP0_MAGIC)) != MCAP0_MAGIC:
                raise UsageError(f"{path}: not an MCAP file")
            yield from whole_records(stream, wanted)
    except (OSError, McapError) as error:
        raise UsageError(f"{path}: cannot be read ({_one_line(error)})") from error


def _opened(path: Path) -> BinaryIO:
    """Open a log for reading; one whose writer has finished it since it was found, by its new name."""
    try:
        return path.open("rb")
    except FileNotFoundError:
        if path.name != PART_NAME:
            raise
        return path.with_name(FILE_NAME).open("rb")


def _frame(seq: int, camera: bytes, mask: bytes) -> LoggedFrame:
    """Decode a frame from its two messages."""
    jpeg = CompressedImage.FromString(camera).data
    return LoggedFrame(seq, decode_jpeg(jpeg), decode_mask(CompressedImage.FromString(mask).data), jpeg)


def _one_line(error: Exception) -> str:
    return " ".join(f"{type(error).__name__} {error}".split())
