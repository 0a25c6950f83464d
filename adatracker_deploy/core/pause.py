"""Simulated suspend time of a rehearsal: one number in a file shared by the run's processes.

In a real suspend CLOCK_MONOTONIC stops and CLOCK_BOOTTIME goes on. A rehearsal stops its processes instead
and adds the time here before they continue; their `MonotonicClock` subtracts it. Nobody reads the file while
it is written, because every reader is stopped.
"""

from __future__ import annotations

import functools
import mmap
import os
import struct

_TOTAL = struct.Struct("<q")


def create(path: str) -> None:
    """Create the file with a suspend time of 0.

    Raises:
        OSError: it cannot be written, or exists already.
    """
    fd = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
    with os.fdopen(fd, "wb") as file:
        file.write(_TOTAL.pack(0))


def add(path: str, slept_ns: int) -> None:
    """Add to the suspend time, ns."""
    shared = _shared(path)
    _TOTAL.pack_into(shared, 0, total_ns(path) + slept_ns)


def total_ns(path: str) -> int:
    """Return the total suspend time, ns."""
    (total,) = _TOTAL.unpack_from(_shared(path))
    return int(total)


@functools.cache
def _shared(path: str) -> mmap.mmap:
    with open(path, "r+b") as file:  # noqa: PTH123 -- read at every look at a clock: a plain path suffices
        return mmap.mmap(file.fileno(), _TOTAL.size)
