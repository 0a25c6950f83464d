"""The quadruped's adapter: sends body velocities to a robot that speaks ROS 2 over Zenoh."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

from adatracker_deploy.config.camera_topic import with_camera
from adatracker_deploy.core.camera import ROBOT
from adatracker_deploy.core.clock import until
from adatracker_deploy.core.errors import PlatformError
from adatracker_deploy.runtime.velocity_adapter import VelocityAdapter
from adatracker_quadruped.adapter.preflight import judge
from adatracker_quadruped.adapter.probe import probe
from adatracker_quadruped.adapter.transport import Wire
from adatracker_quadruped.protocol.connection import Connection
from adatracker_quadruped.protocol.keys import Keys

if TYPE_CHECKING:
    from adatracker_deploy.config.profile import Profile
    from adatracker_deploy.core.camera import Camera
    from adatracker_deploy.core.clock import Clock
    from adatracker_deploy.platform import Check


class QuadrupedAdapter(VelocityAdapter[Wire]):
    """A walking robot behind Zenoh, whose lease this host has while it drives.

    Engaging checks that the robot listens and is heard; a stop latches (`VelocityAdapter`).
    """

    name = "quadruped"
    carrier = "Zenoh"
    Connection = Connection
    default_profile = "go2"

    @classmethod
    def identity(cls, profile: Profile) -> str:
        """Name the quadruped's connection: the same for every profile that reaches it from this machine."""
        return str(profile.connection.robot)

    def __init__(self, profile: Profile, clock: Clock) -> None:
        super().__init__(profile, clock)
        self._connection: Connection = profile.connection

    def _open(self) -> Wire:
        """Dial the robot and wait for its odometry.

        Raises:
            PlatformError: nobody answers, or no odometry comes, within `connect_timeout_s` in all.
            UsageError: a certificate's file is not there.
        """
        deadline_s = time.monotonic() + self._connection.connect_timeout_s
        wire = Wire(self._connection, self.clock)
        if not until(lambda: wire.odometry is not None, deadline_s):
            dropped = wire.watch.odometry.dropped
            wire.close()
            raise PlatformError(
                f"{self._connection.endpoint} answers, but no odometry came on "
                f"{Keys(self._connection).odometry} within {self._connection.connect_timeout_s:g} s"
                + (f" ({dropped} malformed messages did)" if dropped else "")
                + ": start the robot's nodes, or correct connection.odometry_topic, namespace or dialect"
            )
        return wire

    def preflight(self) -> tuple[Check, ...]:
        """Listen for half a second, at most two, and check what was heard."""
        carries_camera = self.profile.camera.uri.startswith(ROBOT)
        camera_key = Keys(with_camera(self.profile)).camera if carries_camera else ""
        with self._opening:
            return judge(probe(self._connected(), camera_key), self._connection)

    @classmethod
    def camera(cls, profile: Profile, clock: Clock) -> Camera:
        """Return the robot's own camera: CompressedImage on the topic after ``robot://``."""
        from adatracker_quadruped.adapter.camera import ZenohCamera

        return ZenohCamera(profile, clock)
