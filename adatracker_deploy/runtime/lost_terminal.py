"""Output to a terminal that may go away, as when SSH drops.

The kernel fails every write to a terminal from the moment that it hangs up, which is before SIGHUP arrives:
the shell is told first. A robot must not depend on a line that nobody reads.
"""

from __future__ import annotations

import contextlib
import errno
import io
import os
import sys
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterator
    from typing import TextIO

    from _typeshed import ReadableBuffer


class _Terminal(io.FileIO):
    """A terminal's descriptor; what is written after it hung up is lost."""

    def write(self, data: ReadableBuffer, /) -> int:
        try:
            return super().write(data)
        except OSError as error:
            if error.errno != errno.EIO:
                raise
            return memoryview(data).nbytes


@contextlib.contextmanager
def tolerated() -> Iterator[None]:
    """Within, a hung-up terminal costs its lines and raises nothing; other outputs are left as they are."""
    before = sys.stdout, sys.stderr
    sys.stdout, sys.stderr = (_tolerant(stream) for stream in before)
    try:
        yield
    finally:
        for stream in (sys.stdout, sys.stderr):
            stream.flush()
        sys.stdout, sys.stderr = before


def let_go(descriptors: tuple[int, ...]) -> None:
    """Redirect those that are a terminal no more to nowhere: libraries that write to them need no EIO."""
    for number in descriptors:
        if not os.isatty(number):
            nowhere = os.open(os.devnull, os.O_WRONLY)
            os.dup2(nowhere, number)
            os.close(nowhere)


def _tolerant(stream: TextIO) -> TextIO:
    try:
        if not stream.isatty():
            return stream
        number = stream.fileno()
    except (OSError, ValueError, AttributeError):  # a test's or a notebook's stream
        return stream
    stream.flush()
    return io.TextIOWrapper(
        io.BufferedWriter(_Terminal(number, "wb", closefd=False)),
        encoding=stream.encoding,
        errors=stream.errors,
        line_buffering=True,
    )
