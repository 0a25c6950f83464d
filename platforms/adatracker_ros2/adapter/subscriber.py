"""Subscriber: keeps the newest valid message of one topic, with its reception time."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Generic, Protocol, TypeVar

from adatracker_deploy.core.stamps import StampOrder
from adatracker_ros2.protocol.messages import TYPES, Malformed
from adatracker_ros2.protocol.qos import ros_qos

if TYPE_CHECKING:
    from collections.abc import Callable

    from adatracker_deploy.core.clock import Clock
    from adatracker_ros2.protocol.connection import Qos
    from adatracker_ros2.protocol.participant import Participant

T = TypeVar("T")


class _Stamped(Protocol):
    @property
    def stamp_ns(self) -> int: ...


S = TypeVar("S", bound=_Stamped)


@dataclass(frozen=True, slots=True)
class Reading(Generic[T]):
    """A message as it was received."""

    value: T
    t_ns: int
    """Reception time, by the run's clock."""
    count: int
    """Number of valid messages so far, including this one."""


class Subscriber(Generic[T]):
    """Subscribes to one topic.

    Args:
        participant: in whose thread messages are read; not yet started.
        topic: in full.
        type_name: of its messages.
        qos: what is requested.
        decode: returns what a message says, or raises ValueError: it is then dropped and counted.
        clock: the run's.
    """

    def __init__(
        self,
        participant: Participant,
        topic: str,
        *,
        type_name: str,
        qos: Qos,
        decode: Callable[[Any], T],
        clock: Clock,
    ) -> None:
        self.topic = topic
        self.type_name = type_name
        self.qos = ros_qos(qos)
        self._decode = decode
        self._clock = clock
        self.newest: Reading[T] | None = None
        self.dropped = 0
        """Number of malformed or repeated messages."""
        participant.node.create_subscription(TYPES[type_name], topic, self._take, self.qos)

    def _take(self, message: Any) -> None:
        t_ns = self._clock.now_ns()
        try:
            value = self._decode(message)
        except ValueError:
            self.dropped += 1
            return
        self.newest = Reading(value, t_ns, self.newest.count + 1 if self.newest else 1)


class Fresh(Generic[S]):
    """Decodes only messages newer than all before: a repeated message is not a new measurement.

    Args:
        decode: returns what a message says, or raises ValueError.
        clock: the run's.
    """

    def __init__(self, decode: Callable[[Any], S], clock: Clock) -> None:
        self._decode = decode
        self._clock = clock
        self._order = StampOrder()
        self._restarted_ns: int | None = None

    def __call__(self, message: Any) -> S:
        """Return what a message says.

        Raises:
            Malformed: it cannot be, or its stamp is not newer than the newest.
        """
        value = self._decode(message)
        restarts = self._order.restarts
        if self._order.is_new(value.stamp_ns):
            return value
        if self._order.restarts > restarts:
            self._restarted_ns = self._clock.now_ns()
        raise Malformed(f"the stamp {value.stamp_ns} is not new")

    def restarted_s(self) -> float:
        """Return the machine's seconds since the stamps last went back; infinite if they never did."""
        if self._restarted_ns is None:
            return math.inf
        return (self._clock.now_ns() - self._restarted_ns) / 1e9 / self._clock.speed
