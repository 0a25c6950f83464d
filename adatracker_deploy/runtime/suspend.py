"""Whether the machine was suspended while a robot was driven: what was asked for before counts no more."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from adatracker_deploy.core.clock import Clock

LONGEST_NS = 100_000_000
"""Below this it is no suspend but two clocks that were not read at quite the same time."""


class SuspendWatch:
    """Compares the clock's suspends with what they were when the robot was engaged.

    Args:
        clock: the run's; it stands still in a suspend, so no age of a command shows one.
    """

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._began_ns = clock.suspended_ns()

    def begin(self) -> None:
        """Watch from now on; what came before counts no more."""
        self._began_ns = self._clock.suspended_ns()

    def trouble(self) -> str:
        """Say for how long the machine was suspended; empty if it was not."""
        asleep_ns = self._clock.suspended_ns() - self._began_ns
        return f"the machine was suspended for {asleep_ns / 1e9:.1f} s" if asleep_ns > LONGEST_NS else ""
