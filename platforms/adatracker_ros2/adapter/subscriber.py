"""Subscriber: keeps the newest valid message of one topic, with its reception time."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Generic, TypeVar

from adatracker_deploy.core.stamps import Reading
from adatracker_ros2.protocol.messages import TYPES
from adatracker_ros2.protocol.qos import ros_qos

if TYPE_CHECKING:
    from collections.abc import Callable

    from adatracker_deploy.core.clock import Clock
    from adatracker_ros2.protocol.connection import Qos
    from adatracker_ros2.protocol.participant import Participant

T = TypeVar("T")


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
