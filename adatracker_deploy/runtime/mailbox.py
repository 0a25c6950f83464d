"""A mailbox in shared memory that holds one writer's newest message.

The writer never waits; it overwrites the older of two slots. Each slot has a number and a checksum, so a
reader takes the newest whole one. A writer killed while writing loses only that message.
"""

from __future__ import annotations

import struct
import zlib
from typing import Any

_HEADER = struct.Struct("<QII")
_ATTEMPTS = 1000


class Mailbox:
    """Latest message only; one writer, any number of readers.

    Args:
        memory: a writable shared buffer of `Mailbox.size(capacity)` bytes, zero at first.
        capacity: largest message, bytes.
    """

    def __init__(self, memory: Any, capacity: int) -> None:
        self._view = memoryview(memory).cast("B")
        self._capacity = capacity
        self._count = 0

    @staticmethod
    def size(capacity: int) -> int:
        """Return the size of a mailbox, bytes."""
        return 2 * (_HEADER.size + capacity)

    def write(self, message: bytes) -> None:
        """Publish a message.

        Raises:
            ValueError: it is larger than the capacity.
        """
        if len(message) > self._capacity:
            raise ValueError(f"message of {len(message)} bytes does not fit in {self._capacity}")
        self._count += 1
        start = self._slot(self._count)
        body = start + _HEADER.size
        self._view[body : body + len(message)] = message
        _HEADER.pack_into(self._view, start, self._count, len(message), _checksum(self._count, message))

    def read(self) -> bytes | None:
        """Return the newest whole message, or None before the first."""
        for _ in range(_ATTEMPTS):
            even, odd = self._read_slot(0), self._read_slot(1)
            newest = max(even, odd, key=lambda slot: slot[0] if slot else 0)
            if newest is not None:
                return newest[1]
            if not any(self._view[: _HEADER.size]) and not any(self._view[self._slot(1) :][: _HEADER.size]):
                return None
        raise RuntimeError("mailbox: no whole message in either slot; its memory was overwritten")

    def _read_slot(self, index: int) -> tuple[int, bytes] | None:
        start = self._slot(index)
        number, length, checksum = _HEADER.unpack_from(self._view, start)
        if number == 0 or length > self._capacity:
            return None
        message = bytes(self._view[start + _HEADER.size : start + _HEADER.size + length])
        return (number, message) if _checksum(number, message) == checksum else None

    def _slot(self, number: int) -> int:
        return (number % 2) * (_HEADER.size + self._capacity)


def _checksum(number: int, message: bytes) -> int:
    return zlib.crc32(message, number & 0xFFFFFFFF)
