"""Scans the complete records of an MCAP file, even a truncated one; unwanted records are skipped.

A trial is nearly all pictures: to score it one per cent has to be read. The library's own stream reader reads
everything. Format: https://mcap.dev/spec.
"""

from __future__ import annotations

import io
import os
import struct
from typing import IO, TYPE_CHECKING, Any

from mcap.data_stream import ReadDataStream
from mcap.exceptions import EndOfFile
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, Footer, Header, Message, Metadata, Schema

from adatracker_deploy.trial.unpack import Allowance, unpacked

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

RECORD_SIZE_LIMIT = 64 << 20
"""A record that claims more, bytes, is damage."""

_OPCODE_AND_LENGTH = struct.Struct("<BQ")
_MESSAGE = struct.Struct("<HIQQ")
_HEAD_SIZE = _OPCODE_AND_LENGTH.size + _MESSAGE.size
"""Read at once: most records are messages."""
_READ = {
    int(Opcode.HEADER): Header,
    int(Opcode.SCHEMA): Schema,
    int(Opcode.CHANNEL): Channel,
    int(Opcode.CHUNK): Chunk,
    int(Opcode.METADATA): Metadata,
    int(Opcode.FOOTER): Footer,
}
"""Besides messages; indices and sums follow from these."""
_READ_IN_CHUNKS = {opcode: _READ[opcode] for opcode in (int(Opcode.SCHEMA), int(Opcode.CHANNEL))}
"""A chunk holds messages and these, and no other chunk."""


def whole_records(stream: IO[bytes], wanted: Callable[[str, int], bool]) -> Iterator[tuple[str, Any]]:
    """Give each record with its topic (empty where it has none), up to the end or the first damage.

    Args:
        stream: a file, just behind its magic.
        wanted: whether the data of the message on this topic with this sequence number are wanted; of others
            they are left empty.

    Raises:
        McapError: a chunk is compressed with what is not installed, or would unpack to more than logs do.
    """
    size = os.fstat(stream.fileno()).st_size
    allowance = Allowance(size)
    topics: dict[int, str] = {}
    for topic, record in _records(stream, size, wanted, topics, _READ):
        if isinstance(record, Chunk):
            try:
                data = unpacked(record, allowance)
            except EndOfFile:
                return
            yield from _records(io.BytesIO(data), len(data), wanted, topics, _READ_IN_CHUNKS)
        else:
            yield topic, record


def _records(
    stream: IO[bytes],
    size: int,
    wanted: Callable[[str, int], bool],
    topics: dict[int, str],
    read: dict[int, Any],
) -> Iterator[tuple[str, Any]]:
    at = stream.tell()
    while len(head := stream.read(_HEAD_SIZE)) >= _OPCODE_AND_LENGTH.size:
        opcode, length = _OPCODE_AND_LENGTH.unpack_from(head)
        at += _OPCODE_AND_LENGTH.size + length
        if length > RECORD_SIZE_LIMIT or at > size:
            return
        try:
            if opcode == Opcode.MESSAGE:
                if length < _MESSAGE.size:
                    return
                channel_id, sequence, log_time, publish_time = _MESSAGE.unpack_from(
                    head, _OPCODE_AND_LENGTH.size
                )
                topic = topics.get(channel_id, "")
                data = stream.read(length - _MESSAGE.size) if wanted(topic, sequence) else b""
                yield topic, Message(channel_id, log_time, data, publish_time, sequence)
            elif opcode in read:
                stream.seek(at - length)
                record = read[opcode].read(ReadDataStream(io.BytesIO(stream.read(length))))
                if isinstance(record, Channel):
                    topics[record.id] = record.topic
                yield "", record
                if isinstance(record, Footer):
                    return
            elif opcode == 0:  # no record has it (MCAP, "Records"): a file's or a chunk's blank rest
                return
        except (EndOfFile, struct.error, UnicodeDecodeError, ValueError):
            return
        stream.seek(at)
