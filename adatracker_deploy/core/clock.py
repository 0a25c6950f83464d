"""Time for everything that runs: monotonic, scaled for fast rehearsals, or fake for tests."""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Protocol

from adatracker_deploy.core import pause

if TYPE_CHECKING:
    from collections.abc import Callable

_POLL_S = 0.01
_SURE_NS = 1_000_000
"""Two clocks read within this time, ns, can be compared."""
_READINGS = 20


class Clock(Protocol):
    """A monotonic clock in nanoseconds; picklable, and equal in every process that holds a copy."""

    @property
    def speed(self) -> float:
        """Seconds of this clock per second of the machine's."""

    def now_ns(self) -> int:
        """Return the time now."""

    def sleep_until(self, t_ns: int) -> None:
        """Return at `t_ns` or as soon after as the machine allows; at once when it has passed."""

    def suspended_ns(self) -> int:
        """Return for how long the machine has been suspended since it booted, ns; only differences count."""


@dataclass(frozen=True, slots=True)
class MonotonicClock:
    """The machine's monotonic clock, `speed` times as fast since `epoch_ns`.

    `time.monotonic_ns` is the same in every process of a machine, so copies agree.
    """

    speed: float = 1.0
    epoch_ns: int = field(default_factory=time.monotonic_ns)
    pause: str = ""
    """Path of a `core.pause` file, when a rehearsal simulates a suspend; empty otherwise."""

    def now_ns(self) -> int:
        """Return the epoch plus `speed` times the machine time since then."""
        passed_ns = time.monotonic_ns() - self.epoch_ns - (pause.total_ns(self.pause) if self.pause else 0)
        return self.epoch_ns + round(passed_ns * self.speed)

    def sleep_until(self, t_ns: int) -> None:
        """Sleep for the remaining machine time."""
        left_s = (t_ns - self.now_ns()) / 1e9 / self.speed
        if left_s > 0:
            time.sleep(left_s)

    def suspended_ns(self) -> int:
        """Return how far CLOCK_BOOTTIME is ahead of CLOCK_MONOTONIC, which stops during a suspend.

        A process stopped between the two readings would see a false difference, so the pair read fastest
        counts. Systems without CLOCK_BOOTTIME report no suspend: 0.
        """
        if self.pause:
            return pause.total_ns(self.pause)
        if not hasattr(time, "CLOCK_BOOTTIME"):
            return 0
        best_ns, took_ns = 0, -1
        for _ in range(_READINGS):
            before_ns = time.monotonic_ns()
            ahead_ns = time.clock_gettime_ns(time.CLOCK_BOOTTIME) - before_ns
            last_ns = time.monotonic_ns() - before_ns
            if took_ns < 0 or last_ns < took_ns:
                best_ns, took_ns = ahead_ns, last_ns
            if took_ns < _SURE_NS:
                break
        return best_ns


@dataclass(slots=True)
class FakeClock:
    """A clock for tests: it stands still until told otherwise; sleeping advances it at once."""

    t_ns: int = 1_000_000_000
    speed: float = 1.0
    asleep_ns: int = 0

    def now_ns(self) -> int:
        """Return the time that was last set."""
        return self.t_ns

    def sleep_until(self, t_ns: int) -> None:
        """Jump to `t_ns` unless it has passed."""
        self.t_ns = max(self.t_ns, t_ns)

    def suspended_ns(self) -> int:
        """Return the total simulated suspend, ns."""
        return self.asleep_ns

    def advance(self, seconds: float) -> None:
        """Advance the clock."""
        self.t_ns += round(seconds * 1e9)

    def suspend(self, seconds: float) -> None:
        """Simulate a suspend of the machine; this clock stands still meanwhile."""
        self.asleep_ns += round(seconds * 1e9)


def until(condition: Callable[[], bool], deadline_s: float) -> bool:
    """Wait for a condition until a deadline of `time.monotonic`; return whether it was met."""
    while not condition():
        if time.monotonic() > deadline_s:
            return False
        time.sleep(_POLL_S)
    return True
