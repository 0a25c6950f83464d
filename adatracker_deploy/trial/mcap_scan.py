"""Walks over the records of an MCAP file as they lie, and touches only those that are wanted.

The public reader decodes every record, pictures included, which takes longer than all the rest of scoring.
Messages are therefore found by their headers in mapped memory; everything else, and what a file that was
rewritten with chunks holds, is left to the public reader's decoding.
"""

from __future__ import annotations

import contextlib
import mmap
import struct
from io import BytesIO
from typing import TYPE_CHECKING, Any

from mcap.exceptions import EndOfFile, McapError, RecordLengthLimitExceeded
from mcap.opcode import Opcode
from mcap.records import Channel, Footer, Message
from mcap.stream_reader import StreamReader
from mcap.writer import MCAP0_MAGIC

from adatracker_deploy.errors import UsageError

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator
    from pathlib import Path

    from mcap.records import McapRecord

RECORD_SIZE_LIMIT = 64 << 20
"""A record that claims more, bytes, is damage."""
_RECORD = struct.Struct("<BQ")
"""Opcode and length of what follows."""
_MESSAGE = struct.Struct("<HIQQ")
"""Channel, sequence number, log time and publish time; then the data."""
_MESSAGE_OPCODE = int(Opcode.MESSAGE)


def scan(path: Path, wanted: Collection[str] | None = None) -> Iterator[tuple[str, Any]]:
    """Give each record with its topic (empty where it has none), up to the last whole one.

    Args:
        path: an MCAP file, whole or cut short.
        wanted: leave out the messages of other topics; None for all.

    Raises:
        UsageError: the file cannot be read, or is not MCAP.
    """
    try:
        with path.open("rb") as stream:
            if stream.read(len(MCAP0_MAGIC)) != MCAP0_MAGIC:
                raise UsageError(f"{path}: not an MCAP file")
            with mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ) as content:
                yield from _records(content, wanted)
    except (OSError, McapError) as error:
        raise UsageError(f"{path}: cannot be read ({one_line(error)})") from error


def one_line(error: Exception) -> str:
    """Return an error's kind and message in one line."""
    return " ".join(f"{type(error).__name__} {error}".split())


def _records(content: mmap.mmap, wanted: Collection[str] | None) -> Iterator[tuple[str, Any]]:
    topics: dict[int, str] = {}
    unwanted: set[int] = set()
    at, size, ended = len(MCAP0_MAGIC), len(content), False
    while not ended and at + _RECORD.size <= size:
        opcode, length = _RECORD.unpack_from(content, at)
        body, end = at + _RECORD.size, at + _RECORD.size + length
        if length > RECORD_SIZE_LIMIT or end > size:
            return
        at = end
        if opcode == _MESSAGE_OPCODE and length >= _MESSAGE.size:
            channel, sequence, log_ns, publish_ns = _MESSAGE.unpack_from(content, body)
            if channel not in unwanted:
                data = content[body + _MESSAGE.size : end]
                yield topics.get(channel, ""), Message(channel, log_ns, data, publish_ns, sequence)
            continue
        for record in _decoded(content[body - _RECORD.size : end]):
            if isinstance(record, Channel):
                topics[record.id] = record.topic
                if wanted is not None and record.topic not in wanted:
                    unwanted.add(record.id)
            if not isinstance(record, Message):
                yield "", record
            elif record.channel_id not in unwanted:
                yield topics.get(record.channel_id, ""), record
            ended = isinstance(record, Footer)


def _decoded(record: bytes) -> Iterator[McapRecord]:
    """Give the record, or those in it if it is a chunk; what damage looks like is any of these errors."""
    with contextlib.suppress(EndOfFile, RecordLengthLimitExceeded, struct.error, UnicodeDecodeError):
        yield from StreamReader(BytesIO(record), skip_magic=True).records
