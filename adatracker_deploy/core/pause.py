"""For how long a rehearsal's machine has slept: one number in a file that the run's processes share.

In a real suspend CLOCK_MONOTONIC stands still and CLOCK_BOOTTIME goes on. A rehearsal stops its processes
instead, adds the time here before they go on, and their `MonotonicClock` takes it off. Nobody reads it while
it is written: whoever reads is stopped.
"""

from __future__ import annotations

import functools
import mmap
import os
import struct

_TOTAL = struct.Struct("<q")


def create(path: str) -> None:
    """Make the file; nothing has slept yet.

    Raises:
        OSError: it cannot be written, or exists.
    """
    fd = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
    with os.fdopen(fd, "wb") as file:
        file.write(_TOTAL.pack(0))


def add(path: str, slept_ns: int) -> None:
    """Note that the machine has slept for longer, ns."""
    shared = _shared(path)
    _TOTAL.pack_into(shared, 0, total_ns(path) + slept_ns)


def total_ns(path: str) -> int:
    """Return for how long the machine has slept in all, ns."""
    (total,) = _TOTAL.unpack_from(_shared(path))
    return int(total)


@functools.cache
def _shared(path: str) -> mmap.mmap:
    with open(path, "r+b") as file:  # noqa: PTH123 -- read at every look at a clock: a plain path suffices
        return mmap.mmap(file.fileno(), _TOTAL.size)
