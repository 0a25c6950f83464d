"""Command publisher: sends velocities as the message type that the robot takes."""

from __future__ import annotations

from typing import TYPE_CHECKING

from adatracker_deploy.core.errors import PlatformError, line_of
from adatracker_ros2.protocol.messages import TYPES, write_command
from adatracker_ros2.protocol.qos import ros_qos
from adatracker_ros2.protocol.topics import Topics

if TYPE_CHECKING:
    from adatracker_deploy.core.messages import Twist
    from adatracker_ros2.protocol.connection import Connection
    from adatracker_ros2.protocol.participant import Participant


class Commander:
    """Sends velocities; none of its calls waits for the robot.

    Args:
        participant: whose node publishes.
        connection: says in what form.
    """

    def __init__(self, participant: Participant, connection: Connection) -> None:
        topics = Topics(connection)
        self.topic = topics.command
        self.type_name = topics.command_type
        self.qos = ros_qos(connection.command_qos)
        self._frame = connection.command_frame
        self._publisher = participant.node.create_publisher(TYPES[self.type_name], self.topic, self.qos)

    @property
    def matched(self) -> bool:
        """Return whether somebody subscribes to the commands, with this type and a quality that fits."""
        return bool(self._publisher.get_subscription_count())

    def drive(self, twist: Twist, stamp_ns: int) -> None:
        """Send one velocity.

        Args:
            twist: its vertical part has no meaning for a robot on the ground.
            stamp_ns: when it was made, since 1970; only a TwistStamped tells it.

        Raises:
            PlatformError: it is not finite, or not a velocity that anything drives with, or ROS 2 refuses it.
        """
        message = write_command(self.type_name, twist, stamp_ns, self._frame)
        try:
            self._publisher.publish(message)
        except Exception as error:  # whatever the middleware raises
            raise PlatformError(f"{self.topic} cannot be published to: {line_of(error)}") from error
