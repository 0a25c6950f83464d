"""Orders a sender's time stamps: which messages are new, and when the sender restarted. Pure."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Generic, Protocol, TypeVar

if TYPE_CHECKING:
    from collections.abc import Callable

    from adatracker_deploy.core.clock import Clock


class Stamped(Protocol):
    """A message that tells when it was made."""

    @property
    def stamp_ns(self) -> int:
        """By the sender's clock; 0 where it gives none."""


T = TypeVar("T")
M_co = TypeVar("M_co", covariant=True)
P = TypeVar("P")
S = TypeVar("S", bound=Stamped)

RESTARTED_AFTER = 3
"""This many consecutive older stamps are not reordered packets: the sender restarted, or its clock was set
back."""


@dataclass(frozen=True, slots=True)
class Reading(Generic[M_co]):
    """A message as it was received."""

    value: M_co
    t_ns: int
    """Reception time, by the run's clock."""
    count: int
    """Number of valid messages so far, including this one."""


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


class NotNew(ValueError):  # noqa: N818 - what the message is
    """A message that is not newer than all before it; it is to be dropped and counted."""


class Fresh(Generic[P, S]):
    """Decodes only messages newer than all before: a repeated message is not a new measurement.

    Args:
        decode: returns the message in a payload, or raises ValueError.
        clock: the run's.
    """

    def __init__(self, decode: Callable[[P], S], clock: Clock) -> None:
        self._decode = decode
        self._clock = clock
        self._order = StampOrder()
        self._restarted_ns: int | None = None

    def __call__(self, payload: P) -> S:
        """Return the message in a payload.

        Raises:
            NotNew: its stamp is not newer than the newest.
            ValueError: it is invalid.
        """
        message = self._decode(payload)
        restarts = self._order.restarts
        if self._order.is_new(message.stamp_ns):
            return message
        if self._order.restarts > restarts:
            self._restarted_ns = self._clock.now_ns()
        raise NotNew(f"the stamp {message.stamp_ns} is not new")

    def restarted_s(self) -> float:
        """Return the machine's seconds since the stamps last went back; infinite if they never did."""
        if self._restarted_ns is None:
            return math.inf
        return (self._clock.now_ns() - self._restarted_ns) / 1e9 / self._clock.speed


def fresh_or_none(value: T | None, t_ns: int, clock: Clock, timeout_s: float) -> T | None:
    """Return a measurement, or None if it is too old.

    Args:
        value: the newest measurement.
        t_ns: when it was received, by the run's clock.
        clock: the run's.
        timeout_s: largest age in machine seconds.
    """
    return value if (clock.now_ns() - t_ns) / 1e9 / clock.speed <= timeout_s else None
