"""Heartbeat monitor: does a process still update what it writes? Pure."""

from __future__ import annotations

from dataclasses import dataclass, replace

LINK_LOST = "the link process died or hangs; the robot's own time-out stops it"
SILENT_S = 3.0
"""A link silent for this long hangs: it steps 50 times a second and never waits."""
LONGEST_LOOK_S = 0.5
"""If the last look is longer ago, the watcher itself was delayed, and cannot tell."""


@dataclass(frozen=True, slots=True)
class Pulse:
    """The heartbeat as seen so far; each look returns the next state."""

    beat: int | None = None
    """The last value written: anything that changes with each write."""
    looked_s: float = 0.0
    silent_s: float = 0.0
    """Time without a new value."""

    def look(self, beat: int | None, now_s: float) -> Pulse:
        """Take the value read at `now_s`, machine time."""
        passed_s = now_s - self.looked_s
        if beat != self.beat:
            return Pulse(beat, now_s)
        silent_s = self.silent_s + passed_s if passed_s <= LONGEST_LOOK_S else 0.0
        return replace(self, looked_s=now_s, silent_s=silent_s)

    @property
    def beats(self) -> bool:
        """Whether the process still runs, as far as known."""
        return self.silent_s < SILENT_S
