"""Detects stalls of the machine itself: on each core a thread sleeps and records how much it overslept."""

from __future__ import annotations

import os
import threading
import time
from typing import Self

NAP_S = 0.01
WORTH_NOTING_S = 0.01
"""Shorter oversleeping is normal."""


class StallMonitor:
    """Context that monitors stalls; a late stop during a stall of the same size is the machine's fault, not
    ours."""

    def __init__(self) -> None:
        self._noted: list[tuple[int, float]] = []
        """(machine time at its end, ns; its length, s)."""
        self._ended = threading.Event()
        # A host may stop a single core, and with it whichever of a robot's processes was on it.
        self._threads = [
            threading.Thread(target=self._watch, args=(core,), name=f"stalls of core {core}", daemon=True)
            for core in sorted(os.sched_getaffinity(0))
        ]

    def __enter__(self) -> Self:
        for thread in self._threads:
            thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ended.set()
        for thread in self._threads:
            thread.join()

    def largest_s(self, since_ns: int, until_ns: int) -> float:
        """Return the longest stall of any core that overlaps an interval of machine time; 0 for none."""
        return max(
            (
                stall_s
                for over_ns, stall_s in list(self._noted)
                if over_ns >= since_ns and over_ns - stall_s * 1e9 <= until_ns
            ),
            default=0.0,
        )

    def _watch(self, core: int) -> None:
        os.sched_setaffinity(threading.get_native_id(), {core})
        slept_ns = time.monotonic_ns()
        while not self._ended.wait(NAP_S):
            now_ns = time.monotonic_ns()
            stall_s = (now_ns - slept_ns) / 1e9 - NAP_S
            if stall_s > WORTH_NOTING_S:
                self._noted.append((now_ns, stall_s))
            slept_ns = now_ns
