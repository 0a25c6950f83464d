"""The ROS 2 robot's adapter: sends body velocities to whatever takes Twist and gives Odometry."""

from __future__ import annotations

import importlib.util
import time
from dataclasses import replace
from typing import TYPE_CHECKING

from adatracker_deploy.config.camera_topic import with_camera
from adatracker_deploy.core.camera import ROBOT
from adatracker_deploy.core.clock import until
from adatracker_deploy.core.errors import PlatformError, UsageError
from adatracker_deploy.runtime.velocity_adapter import VelocityAdapter
from adatracker_ros2.adapter.preflight import judge
from adatracker_ros2.adapter.probe import probe
from adatracker_ros2.protocol.connection import Connection
from adatracker_ros2.protocol.topics import Topics, claimed

if TYPE_CHECKING:
    from collections.abc import Callable

    from adatracker_deploy.config.profile import Profile
    from adatracker_deploy.core.camera import Camera
    from adatracker_deploy.core.clock import Clock
    from adatracker_deploy.platform import Check
    from adatracker_ros2.adapter.transport import Wire


class Ros2Adapter(VelocityAdapter["Wire"]):
    """A robot on the ground, reached by a node of this host's.

    Engaging checks that it listens, is heard, and that nobody else commands it; who begins to has it
    (`_yield`). A stop latches (`VelocityAdapter`).
    """

    name = "ros2"
    carrier = "ROS 2"
    Connection = Connection
    default_profile = "ros2_robot"

    @classmethod
    def identity(cls, profile: Profile) -> str:
        """Name the robot's command topic: the same for every profile that reaches it from this machine."""
        return claimed(profile.connection)

    def __init__(self, profile: Profile, clock: Clock) -> None:
        super().__init__(profile, clock)
        self._connection: Connection = profile.connection

    def _open(self) -> Wire:
        """Join the graph and wait for the robot's odometry and command subscription.

        Raises:
            PlatformError: ROS 2 does not start, or no odometry comes, within `connect_timeout_s`.
            UsageError: rclpy is missing, or a topic has another type or quality of service than it should.
        """
        deadline_s = time.monotonic() + self._connection.connect_timeout_s
        wire = _open(_with_own_camera(self.profile), self.clock, self._yield)
        try:
            until(lambda: wire.odometry is not None and wire.commander.matched, deadline_s)
            if why := wire.misfit():
                raise UsageError(f"{why}: correct the profile's connection")
            if wire.odometry is None:
                raise PlatformError(_unheard(wire, self._connection))
        except BaseException:
            wire.close()
            raise
        return wire

    def preflight(self) -> tuple[Check, ...]:
        """Listen for half a second, at most two, and check what was heard."""
        camera_topic = Topics(_with_own_camera(self.profile)).camera
        with self._opening:
            heard = probe(self._connected(), camera_topic)
            return judge(heard, self._connection, self.profile.camera.fov_deg)

    @classmethod
    def camera(cls, profile: Profile, clock: Clock) -> Camera:
        """Return the robot's own camera: the image topic after ``robot://``."""
        _require_ros()
        from adatracker_ros2.adapter.camera import Ros2Camera

        return Ros2Camera(profile, clock)

    def _reason(self, wire: Wire | None) -> str:
        """Return why it is stopped; whose the robot is comes with a name a moment after the stop."""
        return wire.ownership.latest() if self._taken and wire is not None else super()._reason(wire)


def _open(connection: Connection, clock: Clock, on_rival: Callable[[], None]) -> Wire:
    _require_ros()
    from adatracker_ros2.adapter.transport import Wire

    return Wire(connection, clock, on_rival)


def _require_ros() -> None:
    """Refuse without rclpy; it is not imported to describe a robot, for that takes half a second."""
    if importlib.util.find_spec("rclpy") is None:
        raise UsageError(
            "platform 'ros2' needs rclpy: source your ROS 2 installation, "
            "or pip install 'adatracker-deploy[ros2]'"
        )


def _unheard(wire: Wire, connection: Connection) -> str:
    dropped = f" ({wire.dropped} malformed messages did)" if wire.dropped else ""
    return (
        f"no odometry came on {wire.watch.odometry.topic} in domain {connection.domain} within "
        f"{connection.connect_timeout_s:g} s{dropped}: start the robot's driver, or correct "
        "connection.odometry_topic, namespace, domain or discovery"
    )


def _with_own_camera(profile: Profile) -> Connection:
    """Return the connection with its camera's topic; with none where the camera is not the robot's.

    Raises:
        UsageError: as `with_camera`.
    """
    if profile.camera.uri.startswith(ROBOT):
        found: Connection = with_camera(profile)
        return found
    connection: Connection = profile.connection
    return replace(connection, camera_topic="", camera_info_topic="")
