"""A virtual camera: renders a world from the robot's reported pose.

The robot may be simulated or real: a real drone in an empty field, or any other autopilot or simulator with
the same protocol, can follow a virtual person this way.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from adatracker_deploy.core.geometry import Pose
from adatracker_deploy.sim.rehearsal import take_frame

if TYPE_CHECKING:
    from collections.abc import Callable

    from adatracker_deploy.core.messages import Frame
    from adatracker_deploy.platform import CameraMount
    from adatracker_deploy.sim import World


@dataclass(frozen=True, slots=True)
class Anchor:
    """Where the robot's own fixed frame lies in the world: turned by `yaw`, then moved."""

    x: float
    y: float
    z: float
    """Height of the ground at the robot's start, the zero of its own heights."""
    yaw: float

    @classmethod
    def between(cls, robot: Pose, world: Pose) -> Anchor:
        """Return the anchor that takes `robot`, in its own frame, to above `world`, a place on the ground."""
        yaw = world.yaw - robot.yaw
        x = world.x - math.cos(yaw) * robot.x + math.sin(yaw) * robot.y
        y = world.y - math.sin(yaw) * robot.x - math.cos(yaw) * robot.y
        return cls(x, y, world.z, yaw)

    def to_world(self, pose: Pose) -> Pose:
        """Return a pose of the robot's frame in the world."""
        c, s = math.cos(self.yaw), math.sin(self.yaw)
        return Pose(
            self.x + c * pose.x - s * pose.y,
            self.y + s * pose.x + c * pose.y,
            self.z + pose.z,
            pose.roll,
            pose.pitch,
            pose.yaw + self.yaw,
        )


class WorldCamera:
    """Renders `world` whenever it is read.

    The first frame anchors the robot at the world's start, which faces the target; the people stand still
    until `go`.

    Args:
        world: the world; stepped here and nowhere else.
        mount: where the camera sits on the body.
        pose: returns the robot's newest reported pose, or None.
        size: image width and height, px.
    """

    def __init__(
        self, world: World, mount: CameraMount, pose: Callable[[], Pose | None], size: tuple[int, int]
    ) -> None:
        self._world = world
        self._mount = mount
        self._pose = pose
        self._size = size
        self._anchor: Anchor | None = None
        self._going = False
        self._last_ns: int | None = None
        self._seq = 0

    def open(self) -> None:
        """Do nothing: there is no device, and no pose yet."""

    def close(self) -> None:
        """Do nothing."""

    def go(self) -> None:
        """Let the people walk from the next frame on."""
        self._going = True

    def read(self, now_ns: int) -> Frame | None:
        """Move the world to `now_ns` and render it; None while the robot has reported no pose."""
        reported = self._pose()
        if reported is None:
            return None
        if self._anchor is None:
            self._anchor = Anchor.between(reported, self._world.start)
        robot = self._anchor.to_world(reported)
        if self._going:
            last_ns = self._last_ns if self._last_ns is not None else now_ns
            self._world.step((now_ns - last_ns) / 1e9, robot)
            self._last_ns = now_ns
        self._seq += 1
        fov_rad = math.radians(self._mount.fov_deg)
        return take_frame(
            self._world, robot, self._mount.pose(robot), fov_rad, self._size, t_ns=now_ns, seq=self._seq
        )
