"""Detects that the machine was suspended while driving a robot; commands from before are void."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from adatracker_deploy.core.clock import Clock

LONGEST_NS = 100_000_000
"""Shorter differences are not a suspend, but two clocks read at slightly different times."""


class SuspendWatch:
    """Compares the clock's total suspend time with that at engaging.

    Args:
        clock: the run's; it stands still in a suspend, so no age of a command shows one.
    """

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._began_ns = clock.suspended_ns()

    def begin(self) -> None:
        """Start watching; earlier suspends are ignored."""
        self._began_ns = self._clock.suspended_ns()

    def trouble(self) -> str:
        """Describe how long the machine was suspended; empty if it was not."""
        asleep_ns = self._clock.suspended_ns() - self._began_ns
        return f"the machine was suspended for {asleep_ns / 1e9:.1f} s" if asleep_ns > LONGEST_NS else ""
