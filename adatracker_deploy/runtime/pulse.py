"""Whether a process that should write something new all the time still does. Pure."""

from __future__ import annotations

from dataclasses import dataclass, replace

LINK_LOST = "the link process died or hangs; the robot's own time-out stops it"
SILENT_S = 3.0
"""A link that has said nothing new for so long hangs: it steps 50 times a second, and waits for nobody."""
LONGEST_LOOK_S = 0.5
"""Who has not looked for longer was held up itself, and does not know."""


@dataclass(frozen=True, slots=True)
class Pulse:
    """What has been seen of a process up to now; each look returns the next."""

    beat: int | None = None
    """What it wrote last: anything that changes with each writing."""
    looked_s: float = 0.0
    silent_s: float = 0.0
    """For how long whoever looks has seen nothing new."""

    def look(self, beat: int | None, now_s: float) -> Pulse:
        """Take what is there at `now_s`, machine time."""
        passed_s = now_s - self.looked_s
        if beat != self.beat:
            return Pulse(beat, now_s)
        silent_s = self.silent_s + passed_s if passed_s <= LONGEST_LOOK_S else 0.0
        return replace(self, looked_s=now_s, silent_s=silent_s)

    @property
    def beats(self) -> bool:
        """Whether it still runs, as far as can be told."""
        return self.silent_s < SILENT_S
