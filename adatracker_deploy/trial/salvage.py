"""Recovers unfinished logs: turns the ``.mcap.part`` of a killed writer or a power cut into an MCAP.

Every whole record is written again, for only a finished file has the index that other readers want. The
original stays until the new file is on the disk. A log that is still being written is left alone: its writer
holds a lock.
"""

from __future__ import annotations

import contextlib
import fcntl
import os
from dataclasses import dataclass
from typing import IO, TYPE_CHECKING

from mcap.exceptions import McapError
from mcap.records import Channel, Footer, Message, Metadata, Schema
from mcap.writer import MCAP0_MAGIC

from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.trial.folder import PART_NAME, sync_folder
from adatracker_deploy.trial.scan import whole_records
from adatracker_deploy.trial.search import search
from adatracker_deploy.trial.trial_file import start_mcap

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

FINISHED_SUFFIX, PART_SUFFIX = ".mcap", ".part"
_NEW_SUFFIX = ".salvaging"


@dataclass(frozen=True, slots=True)
class Salvaged:
    """A log that is whole now."""

    path: Path
    steps: int
    lost_bytes: int
    """Behind the last whole record."""


def unfinished(path: Path) -> list[Path]:
    """Return the unfinished logs that a path names: itself, or those in and below a folder, sorted.

    A finished log does not count, and folders may have none: then there is nothing to do.

    Raises:
        UsageError: nothing is there, it is not a log, or a folder may not be read.
    """
    if path.is_dir():
        found = search(path, PART_NAME.__eq__)
        if found.refused and not found.files:
            raise UsageError(f"{found.refused[0]}: may not be read")
        return found.files
    if not path.is_file():
        raise UsageError(f"{path}: no such file or folder")
    if path.name.endswith(FINISHED_SUFFIX):
        return []
    if path.suffix != PART_SUFFIX:
        raise UsageError(f"{path}: not a log: an unfinished one ends in {FINISHED_SUFFIX}{PART_SUFFIX}")
    return [path]


def salvage(part: Path) -> Salvaged:
    """Make an unfinished log whole: ``NAME.mcap.part`` becomes ``NAME.mcap``.

    Raises:
        UsageError: it is still being written, it is not a trial, or the new file cannot be written; then the
            original is as it was.
    """
    path = part.with_suffix("")
    new = path.with_name(path.name + _NEW_SUFFIX)
    try:
        with part.open("rb") as source, _alone(source, part):
            if path.exists() and _messages(path) < _messages(part):
                raise UsageError(f"{part}: {path.name} is beside it already; move one of them away")
            try:
                with os.fdopen(os.open(new, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600), "wb") as target:
                    steps, lost_bytes = _rewrite(source, target)
                    target.flush()
                    os.fsync(target.fileno())
                new.rename(path)
            except BaseException:
                new.unlink(missing_ok=True)
                raise
            sync_folder(path.parent)
            part.unlink()
    except OSError as error:
        raise UsageError(f"{part}: cannot be salvaged ({error.strerror})") from error
    except (ValueError, McapError) as error:
        raise UsageError(f"{part}: cannot be salvaged ({error})") from error
    return Salvaged(path, steps, lost_bytes)


def salvage_all(log_dir: Path) -> Iterator[str]:
    """Salvage what earlier runs left directly in a folder of trials; give a line for each."""
    for part in sorted(log_dir.glob(f"*/{PART_NAME}")):
        try:
            done = salvage(part)
        except UsageError as error:
            yield f"warning: {error}"
        else:
            yield f"salvaged {done.path.parent}: the log of {done.steps} steps was unfinished"


def _rewrite(source: IO[bytes], target: IO[bytes]) -> tuple[int, int]:
    """Write every whole record of a trial again; return its steps, and how many bytes are behind the last.

    Raises:
        ValueError: it is not a trial.
    """
    if source.read(len(MCAP0_MAGIC)) != MCAP0_MAGIC:
        raise ValueError("not an MCAP file")
    mcap = start_mcap(target)
    schemas, channels = {0: 0}, {}
    steps, end, is_trial = 0, source.tell(), False
    size = os.fstat(source.fileno()).st_size
    for topic, record in whole_records(source, lambda *_: True):
        match record:
            case Schema() if record.id not in schemas:  # the summary at the end repeats them
                schemas[record.id] = mcap.register_schema(record.name, record.encoding, record.data)
            case Channel() if record.id not in channels:
                channels[record.id] = mcap.register_channel(
                    record.topic, record.message_encoding, schemas[record.schema_id], record.metadata
                )
            case Message() if record.channel_id in channels:
                channel = channels[record.channel_id]
                mcap.add_message(channel, record.log_time, record.data, record.publish_time, record.sequence)
                steps += topic == "/step"
            case Metadata():
                mcap.add_metadata(record.name, record.metadata)
                is_trial = is_trial or record.name == "trial"
        end = size if isinstance(record, Footer) else source.tell()
    if not is_trial:
        raise ValueError("it does not name its trial: it was cut off at its very beginning")
    mcap.finish()
    return steps, size - end


def _messages(path: Path) -> int:
    """Count what a log holds; one that was salvaged when the power failed again holds all of its original."""
    with path.open("rb") as stream:
        stream.seek(len(MCAP0_MAGIC))
        return sum(isinstance(record, Message) for _, record in whole_records(stream, lambda *_: False))


@contextlib.contextmanager
def _alone(source: IO[bytes], part: Path) -> Iterator[None]:
    try:
        fcntl.flock(source, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError as error:
        raise UsageError(f"{part}: still being written, by a run that goes on") from error
    yield  # closing the file gives the lock back
