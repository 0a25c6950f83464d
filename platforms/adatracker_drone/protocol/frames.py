"""Converts between the frames of PX4 and JSBSim and those of REP 103; no other module does.

Axes: (north, east, down) is (east, north, up) = (e, n, -d); (forward, right, down) is (forward, left, up) =
(f, -r, -d). Attitudes: roll is the same; pitch changes sign (positive is nose up in PX4, nose down in
REP 103); a heading clockwise from north becomes a yaw counter-clockwise from east.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from adatracker_deploy.core.geometry import Pose, wrap_angle


@dataclass(frozen=True, slots=True)
class NedPose:
    """A place in m and an attitude in rad, as PX4 tells them."""

    north: float = 0.0
    east: float = 0.0
    down: float = 0.0
    roll: float = 0.0
    pitch: float = 0.0
    """Positive is nose up."""
    heading: float = 0.0
    """Clockwise from north, in (-pi, pi]."""

    def to_enu(self) -> Pose:
        """Return the same pose in REP 103."""
        return Pose(
            x=self.east,
            y=self.north,
            z=-self.down,
            roll=self.roll,
            pitch=-self.pitch,
            yaw=wrap_angle(math.pi / 2 - self.heading),
        )

    @classmethod
    def from_enu(cls, pose: Pose) -> NedPose:
        """Return a REP 103 pose as PX4 would tell it."""
        return cls(
            north=pose.y,
            east=pose.x,
            down=-pose.z,
            roll=pose.roll,
            pitch=-pose.pitch,
            heading=wrap_angle(math.pi / 2 - pose.yaw),
        )


def rotate(x: float, y: float, angle_rad: float) -> tuple[float, float]:
    """Turn a horizontal vector by an angle, positive from the first axis to the second.

    Turned by the heading, (forward, right) becomes (north, east); turned by minus the heading, the reverse.
    """
    c, s = math.cos(angle_rad), math.sin(angle_rad)
    return c * x - s * y, s * x + c * y
