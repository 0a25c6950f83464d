"""Orders a sender's time stamps: which messages are new, and when the sender restarted. Pure."""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeVar

if TYPE_CHECKING:
    from adatracker_deploy.core.clock import Clock

T = TypeVar("T")

RESTARTED_AFTER = 3
"""This many consecutive older stamps are not reordered packets: the sender restarted, or its clock was set
back."""


class StampOrder:
    """Tells new messages from repeated and late ones by the sender's stamps.

    If the first stamps are zero, the sender gives none, and all its messages count as new.
    """

    def __init__(self) -> None:
        self._newest_ns = 0
        self._older = 0
        self.restarts = 0
        """Number of times the sender restarted with older stamps, which count as new from then on."""

    def is_new(self, stamp_ns: int) -> bool:
        """Return whether a message with this stamp is newer than all before it."""
        if stamp_ns > self._newest_ns or stamp_ns == self._newest_ns == 0:
            self._newest_ns, self._older = stamp_ns, 0
            return True
        if stamp_ns < self._newest_ns:
            self._older += 1
        if self._older >= RESTARTED_AFTER:
            self._newest_ns, self._older = stamp_ns, 0
            self.restarts += 1
        return False


def fresh_or_none(value: T | None, t_ns: int, clock: Clock, timeout_s: float) -> T | None:
    """Return a measurement, or None if it is too old.

    Args:
        value: the newest measurement.
        t_ns: when it was received, by the run's clock.
        clock: the run's.
        timeout_s: largest age in machine seconds.
    """
    return value if (clock.now_ns() - t_ns) / 1e9 / clock.speed <= timeout_s else None
