"""Command publisher: sends velocities as the message type that the robot takes."""

from __future__ import annotations

from typing import TYPE_CHECKING

from adatracker_deploy.core.messages import ZERO, Twist
from adatracker_quadruped.protocol import sport
from adatracker_quadruped.protocol.keys import Keys
from adatracker_quadruped.protocol.messages import encode_twist, encode_twist_stamped
from adatracker_quadruped.protocol.publisher import Publisher

if TYPE_CHECKING:
    from collections.abc import Callable

    import zenoh

    from adatracker_quadruped.protocol.connection import Connection


class Commander:
    """Sends velocities; none of its calls waits for the robot.

    Args:
        session: to the robot.
        connection: says in what form.
        meant: tells whether the robot is the one that is meant; another is sent nothing, not even a stop.
    """

    def __init__(
        self, session: zenoh.Session, connection: Connection, meant: Callable[[], bool] = lambda: True
    ) -> None:
        self._meant = meant
        keys = Keys(connection)
        self.key = keys.command
        """Key of the commands."""
        self._connection = connection
        self._publisher = Publisher(session, keys.command, attaches=keys.attaches)

    @property
    def matched(self) -> bool:
        """Return whether somebody subscribes to the commands."""
        return self._publisher.matched

    def walk(self, twist: Twist, stamp_ns: int) -> None:
        """Send one velocity.

        Args:
            twist: its vertical part has no meaning for a robot on the ground.
            stamp_ns: when it was made, since 1970; a sport request takes it as its number.

        Raises:
            PlatformError: it is not finite, or not a velocity that anything walks with.
        """
        match self._connection.command:
            case "twist":
                payload = encode_twist(twist)
            case "twist_stamped":
                payload = encode_twist_stamped(twist, stamp_ns, self._connection.command_frame)
            case "unitree_sport":
                payload = sport.encode_move(twist, request_id=stamp_ns)
        if self._meant():
            self._publisher.put(payload, stamp_ns)

    def stand(self, stamp_ns: int) -> None:
        """Announce that no command will follow: StopMove if supported, else another zero."""
        if self._connection.command == "unitree_sport":
            if self._meant():
                self._publisher.put(sport.encode_stop(request_id=stamp_ns), stamp_ns)
        else:
            self.walk(ZERO, stamp_ns)
