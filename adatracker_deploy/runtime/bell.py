"""A bell between two processes: ringing never waits, and who listens wakes at once."""

from __future__ import annotations

import contextlib
import os
import time
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from multiprocessing.connection import Connection

_MOST_RINGS = 4096


class Bell:
    """The end that rings.

    Args:
        end: the writing end of a one-way pipe.
    """

    def __init__(self, end: Connection) -> None:
        os.set_blocking(end.fileno(), False)
        self._end = end

    def ring(self) -> None:
        """Wake whoever listens; nothing happens where nobody does."""
        with contextlib.suppress(OSError):  # closed, or full of rings that nobody has heard
            os.write(self._end.fileno(), b"\0")

    def close(self) -> None:
        """Ring no more; may be called twice."""
        self._end.close()


class Ear:
    """The end that listens.

    Args:
        end: the reading end.
    """

    def __init__(self, end: Connection) -> None:
        self._end = end
        self._deaf = False

    def heard(self, timeout_s: float) -> bool:
        """Wait for a ring, for this long at most; rings before count, and all of them as one.

        Once the ringer is gone, this only waits.
        """
        if self._deaf:
            time.sleep(timeout_s)
            return False
        if not self._end.poll(timeout_s):
            return False
        self._deaf = not os.read(self._end.fileno(), _MOST_RINGS)
        return not self._deaf
