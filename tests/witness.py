"""Watches whether the machine itself stands still.

A virtual machine's host may stop a core for a tenth of a second and more; to everything on it the others then
seem silent, and robots are rightly stopped. The witness wants to run every 5 ms on each core, in a process of
its own, and writes down when it could not. A real-time test that failed meanwhile says nothing about what it
tests.

It also sees that there are fewer such stalls: a host is slow to give back a core that has slept, so on each
core a process that comes after all others works at nothing.
"""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
import threading
import time
from pathlib import Path

PERIOD_S = 0.005
STALL_S = 0.05
"""Half a slot of a loop at 10 Hz: what no robot's silence limit expects of a machine."""


class Witness:
    """A process that watches every core that this one may use."""

    def __init__(self) -> None:
        self._process = subprocess.Popen(
            [sys.executable, "-S", __file__], stdin=subprocess.PIPE, stdout=subprocess.PIPE
        )
        self._process.stdout.readline()  # it watches
        self._stalls: list[tuple[float, float]] = []
        os.set_blocking(self._process.stdout.fileno(), False)
        self._rest = b""

    def longest_s(self, since_s: float) -> float:
        """Return the longest stall since `since_s`, monotonic; 0 where none was longer than `STALL_S`."""
        self._rest += self._process.stdout.read() or b""
        *lines, self._rest = self._rest.split(b"\n")
        self._stalls += [tuple(map(float, line.split())) for line in lines]
        return max((length_s for end_s, length_s in self._stalls if end_s >= since_s), default=0.0)

    def wait_until_calm(self, calm_s: float = 2.0, patience_s: float = 60.0) -> None:
        """Wait for `calm_s` without a stall, for `patience_s` at most."""
        end_s = time.monotonic() + patience_s
        while (now_s := time.monotonic()) < end_s:
            time.sleep(calm_s)
            if not self.longest_s(now_s):
                return

    def close(self) -> None:
        self._process.stdin.close()
        self._process.wait()
        self._process.stdout.close()


def _keep_awake(core: int, parent: int) -> None:
    """Be busy whenever nobody else wants the core, until the parent is gone."""
    os.setsid()
    with contextlib.suppress(OSError):  # a session has its share of a core, however modest its processes
        Path("/proc/self/autogroup").write_text("19", encoding="ascii")
    os.sched_setscheduler(0, os.SCHED_IDLE, os.sched_param(0))
    os.sched_setaffinity(0, {core})
    while os.getppid() == parent:
        for _ in range(1_000_000):
            pass


def _watch(core: int) -> None:
    os.sched_setaffinity(threading.get_native_id(), {core})
    last_s = time.monotonic()
    while True:
        time.sleep(PERIOD_S)
        now_s = time.monotonic()
        if now_s - last_s > STALL_S:
            os.write(1, f"{now_s:.3f} {now_s - last_s:.3f}\n".encode())
        last_s = now_s


if __name__ == "__main__":
    for each in os.sched_getaffinity(0):
        witness = os.getpid()
        if os.fork() == 0:
            _keep_awake(each, witness)
            os._exit(0)
    for each in os.sched_getaffinity(0):
        threading.Thread(target=_watch, args=(each,), daemon=True).start()
    os.write(1, b"\n")
    sys.stdin.read()  # until whoever started it is gone
