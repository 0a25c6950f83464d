"""Detects stalls of this process's interpreter with a thread that only sleeps and reports each delay."""

from __future__ import annotations

import threading
import time
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable

NAP_S = 0.005
WORTH_TELLING_S = 0.05


class InterpreterWatch:
    """Monitors until closed.

    Args:
        stood: called, in its own thread, with the length, s, of a stall that has just ended.
    """

    def __init__(self, stood: Callable[[float], None]) -> None:
        self._stood = stood
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._watch, name="interpreter", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Stop monitoring."""
        self._ended.set()
        self._thread.join()

    def _watch(self) -> None:
        woke_s = time.monotonic()
        while not self._ended.wait(NAP_S):
            now_s = time.monotonic()
            if now_s - woke_s - NAP_S > WORTH_TELLING_S:
                self._stood(now_s - woke_s - NAP_S)
            woke_s = now_s
