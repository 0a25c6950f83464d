"""Watches whether the machine itself stands still, or runs for others.

A virtual machine's host may stop a core for a tenth of a second and more; to everything on it the others then
seem silent, and robots are rightly stopped. The witness wants to run every 5 ms on each core, in a process of
its own, and writes down when it could not. A host may also take the cores in slices that are shorter than
that; how much it took, the kernel counts as steal time. A real-time test that failed meanwhile says nothing
about what it tests.
"""

from __future__ import annotations

import os
import subprocess
import sys
import threading
import time

PERIOD_S = 0.005
STALL_S = 0.05
"""Half a slot of a loop at 10 Hz: what no robot's silence limit expects of a machine."""
STOLEN = 0.05
"""Share of the processors; an idle host takes less than a hundredth."""


class Witness:
    """A process that watches every core that this one may use."""

    def __init__(self) -> None:
        self._process = subprocess.Popen(
            [sys.executable, "-S", __file__], stdin=subprocess.PIPE, stdout=subprocess.PIPE
        )
        self._process.stdout.readline()  # it is about to watch
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
        """Wait for `calm_s` without a stall and with all processors, for `patience_s` at most."""
        end_s = time.monotonic() + patience_s
        while (now_s := time.monotonic()) < end_s:
            times = processor_times()
            time.sleep(calm_s)
            if not self.longest_s(now_s) and stolen_share(times, processor_times()) < STOLEN:
                return

    def close(self) -> None:
        self._process.stdin.close()
        self._process.wait()
        self._process.stdout.close()


def processor_times() -> tuple[int, int]:
    """Return how long all processors have been stolen by the host, and how long there were any (proc(5))."""
    with open("/proc/stat", encoding="ascii") as file:  # noqa: PTH123 -- `-S`: nothing is imported for it
        times = list(map(int, file.readline().split()[1:9]))
    return times[7], sum(times)


def stolen_share(before: tuple[int, int], after: tuple[int, int]) -> float:
    """Return the share of the processors, 0 to 1, that the host took between two `processor_times`."""
    return (after[0] - before[0]) / max(1, after[1] - before[1])


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
    os.write(1, b"\n")  # first of all: a stall may be told before the last thread is started
    for each in os.sched_getaffinity(0):
        threading.Thread(target=_watch, args=(each,), daemon=True).start()
    sys.stdin.read()  # until whoever started it is gone
