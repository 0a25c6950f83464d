"""Keeps a rate by absolute deadlines: no drift, and a missed slot is skipped, never replayed in a burst."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from adatracker_deploy.core.clock import Clock


@dataclass(frozen=True, slots=True)
class Tick:
    """One slot in use."""

    t_ns: int
    """The current time."""
    lateness_s: float
    """Delay of the slot's start after its deadline; at most half a period, unless patience ran out."""
    skipped: int
    """Slots missed since the previous tick."""


class Pacer:
    """Slots at ``start + k / rate``. Two ticks are never closer than half a period."""

    def __init__(self, clock: Clock, rate_hz: float) -> None:
        self._clock = clock
        self._period_ns = 1e9 / rate_hz
        self._start_ns = clock.now_ns()
        self._slot = -1
        self.missed = 0
        """Slots skipped so far."""

    @property
    def due_ns(self) -> int:
        """When the next slot begins."""
        return self._start_ns + round((self._slot + 1) * self._period_ns)

    def shift(self, earlier_s: float) -> None:
        """Let this and all later slots begin sooner, by less than half a period; below 0 later."""
        self._start_ns -= round(earlier_s * 1e9)

    def wait(self, patience: float = math.inf) -> Tick:
        """Sleep until the next slot that is not yet half over.

        Args:
            patience: slots; after this many consecutive missed slots, return at once without sleeping;
                `Tick.skipped` is then at least this.
        """
        skipped = -1
        while True:
            elapsed_ns = self._clock.now_ns() - self._start_ns
            reachable = math.ceil(elapsed_ns / self._period_ns - 0.5)
            next_slot = max(self._slot + 1, reachable)
            skipped += next_slot - self._slot
            self._slot = next_slot
            deadline_ns = self._start_ns + round(next_slot * self._period_ns)
            if skipped < patience:
                self._clock.sleep_until(deadline_ns)
            now_ns = self._clock.now_ns()
            if skipped >= patience or now_ns - deadline_ns <= self._period_ns / 2:
                self.missed += skipped
                return Tick(now_ns, max(0, now_ns - deadline_ns) / 1e9, skipped)
