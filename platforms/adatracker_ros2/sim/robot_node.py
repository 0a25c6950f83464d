"""The simulated robot's node: its topics and parameter, and the commands that it hears."""

from __future__ import annotations

import threading
import time
from typing import TYPE_CHECKING, Any

import sensor_msgs.msg
import std_msgs.msg
from rclpy.lifecycle import LifecycleNode
from rclpy.node import Node

from adatracker_deploy.core.messages import Twist
from adatracker_deploy.perception.jpeg import decode_jpeg
from adatracker_deploy.perception.truth_wire import encode_truth
from adatracker_ros2.protocol.connection import Qos
from adatracker_ros2.protocol.messages import (
    TYPES,
    read_command,
    write_battery,
    write_camera_info,
    write_compressed_image,
    write_image,
    write_odometry,
)
from adatracker_ros2.protocol.participant import Participant
from adatracker_ros2.protocol.qos import ros_qos
from adatracker_ros2.protocol.topics import (
    BATTERY_STATE,
    CAMERA_INFO,
    COMPRESSED_IMAGE,
    IMAGE,
    ODOMETRY,
    Topics,
)

if TYPE_CHECKING:
    from collections.abc import Callable

    from adatracker_deploy.core.camera_info import CameraInfo
    from adatracker_deploy.core.messages import Shot
    from adatracker_ros2.protocol.connection import Connection
    from adatracker_ros2.protocol.messages import Odometry
    from adatracker_ros2.sim.settings import SitlSettings

STALE_S = 0.3
"""An older TwistStamped is dropped."""
_DEPTH = 8


class RobotNode:
    """A robot's driver as others see it in the graph; close it from the thread that made it.

    Args:
        connection: its names and types; on this machine alone, whatever the profile's discovery.
        settings: says what its camera sends.
        lens: its camera's.
        go: called when somebody lets the people walk.

    Raises:
        PlatformError: ROS 2 does not start.
    """

    def __init__(
        self, connection: Connection, settings: SitlSettings, lens: CameraInfo, go: Callable[[], None]
    ) -> None:
        topics = Topics(connection)
        self._lens = lens
        self._raw = settings.images == "raw"
        self._lock = threading.Lock()
        self._command: Twist | None = None
        self.dropped = 0
        """Commands that were malformed or stale."""
        namespace, _, name = topics.robot.rpartition("/")
        parameters = {connection.timeout_parameter: connection.command_timeout_s}
        self._participant = Participant(
            connection,
            name,
            namespace=namespace or "/",
            node_class=LifecycleNode if connection.lifecycle else Node,
            parameters=parameters if connection.timeout_parameter else None,
        )
        node = self._participant.node
        lossless = ros_qos(Qos(reliability="reliable", depth=_DEPTH))
        self.odometry = node.create_publisher(TYPES[ODOMETRY], topics.odometry, lossless)
        self.battery = (
            node.create_publisher(TYPES[BATTERY_STATE], topics.battery, lossless) if topics.battery else None
        )
        self._images = node.create_publisher(
            TYPES[IMAGE if self._raw else COMPRESSED_IMAGE], topics.camera, lossless
        )
        self._infos = node.create_publisher(TYPES[CAMERA_INFO], topics.camera_info, lossless)
        self._truths = node.create_publisher(sensor_msgs.msg.CompressedImage, topics.truth, lossless)
        node.create_subscription(
            TYPES[topics.command_type], topics.command, self._take, ros_qos(Qos(reliability="best_effort"))
        )
        node.create_subscription(std_msgs.msg.Empty, topics.go, lambda _: go(), lossless)
        self._participant.start()
        if connection.lifecycle:
            node.trigger_configure()
            node.trigger_activate()

    def command(self) -> Twist | None:
        """Return the newest command since the last call; None without one."""
        with self._lock:
            command, self._command = self._command, None
            return command

    def tell_odometry(self, odometry: Odometry) -> None:
        """Publish odometry."""
        self.odometry.publish(write_odometry(odometry))

    def tell_battery(self, charge: float) -> None:
        """Publish the charge, if the profile names a topic for it."""
        if self.battery is not None:
            self.battery.publish(write_battery(charge))

    def show(self, shot: Shot, stamp_ns: int) -> None:
        """Publish an image after its truth and its camera_info; called from the camera's thread."""
        self._truths.publish(write_compressed_image(encode_truth(shot.truth), stamp_ns, "truth"))
        self._infos.publish(write_camera_info(self._lens, stamp_ns))
        if self._raw:
            self._images.publish(write_image(decode_jpeg(shot.jpeg), stamp_ns))
        else:
            self._images.publish(write_compressed_image(shot.jpeg, stamp_ns, "jpeg"))

    def close(self) -> None:
        """Leave the graph."""
        self._participant.close()

    def _take(self, message: Any) -> None:
        try:
            twist, stamp_ns = read_command(message)
            if stamp_ns is not None and time.time_ns() - stamp_ns > STALE_S * 1e9:
                raise ValueError("a stale command")
        except ValueError:
            self.dropped += 1
            return
        with self._lock:
            self._command = twist


class Teleop:
    """Somebody else's node that could drive the robot: it publishes on the command topic, so far nothing."""

    def __init__(self, connection: Connection) -> None:
        topics = Topics(connection)
        self._participant = Participant(connection, "teleop")
        self._participant.node.create_publisher(TYPES[topics.command_type], topics.command, 1)
        self._participant.start()

    def close(self) -> None:
        """Leave the graph."""
        self._participant.close()
