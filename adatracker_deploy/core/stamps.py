"""The order of a sender's time stamps: which messages are new, and when the sender began again. Pure."""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeVar

if TYPE_CHECKING:
    from adatracker_deploy.core.clock import Clock

T = TypeVar("T")

RESTARTED_AFTER = 3
"""So many older stamps without a newer one between them are no packets that overtook each other: the sender
was restarted, or its clock was set back."""


class StampOrder:
    """Tells new messages from repeated and belated ones by their sender's stamps.

    A stamp of zero, with no other before it, means that the sender gives none: its messages are all new.
    """

    def __init__(self) -> None:
        self._newest_ns = 0
        self._older = 0
        self.restarts = 0
        """How often the sender has begun again with older stamps, which count as new from then on."""

    def is_new(self, stamp_ns: int) -> bool:
        """Tell whether a message with this stamp is newer than all before it."""
        if stamp_ns > self._newest_ns or stamp_ns == self._newest_ns == 0:
            self._newest_ns, self._older = stamp_ns, 0
            return True
        if stamp_ns < self._newest_ns:
            self._older += 1
        if self._older >= RESTARTED_AFTER:
            self._newest_ns, self._older = stamp_ns, 0
            self.restarts += 1
        return False


def while_told(value: T | None, t_ns: int, clock: Clock, timeout_s: float) -> T | None:
    """Return a measurement, or None where it was told too long ago: what falls silent is no measurement.

    Args:
        value: the newest.
        t_ns: when it was told, by the run's clock.
        clock: the run's.
        timeout_s: of the machine's seconds.
    """
    return value if (clock.now_ns() - t_ns) / 1e9 / clock.speed <= timeout_s else None
