"""The place of a robot's own frame in a virtual world. Pure."""

from __future__ import annotations

import math
from dataclasses import dataclass

from adatracker_deploy.core.geometry import Pose


@dataclass(frozen=True, slots=True)
class Anchor:
    """The robot's own fixed frame in the world: turned by `yaw`, then moved."""

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
