"""Poses and angles: the one place where frames are composed.

Frames follow ROS REP 103: fixed frames are x east (or any), y to its left, z up; body frames are x forward,
y left, z up; yaw is counter-clockwise seen from above. Angles are radians, lengths metres.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Matrix = NDArray[np.float64]


def wrap_angle(angle_rad: float) -> float:
    """Return the same direction in (-pi, pi]."""
    wrapped = math.remainder(angle_rad, math.tau)
    return math.pi if wrapped == -math.pi else wrapped


@dataclass(frozen=True, slots=True)
class Pose:
    """A place and an orientation in a fixed frame; rotation is Rz(yaw) Ry(pitch) Rx(roll).

    With z up and x forward a positive pitch turns the nose *down* (REP 103), so a camera that looks down at
    the ground has a positive pitch.
    """

    x: float = 0.0
    y: float = 0.0
    z: float = 0.0
    roll: float = 0.0
    pitch: float = 0.0
    yaw: float = 0.0

    def rotation(self) -> Matrix:
        """Return the 3x3 matrix that takes body vectors to the fixed frame."""
        cr, sr = math.cos(self.roll), math.sin(self.roll)
        cp, sp = math.cos(self.pitch), math.sin(self.pitch)
        cy, sy = math.cos(self.yaw), math.sin(self.yaw)
        return np.array(
            [
                [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
                [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
                [-sp, cp * sr, cp * cr],
            ]
        )

    def translation(self) -> Matrix:
        """Return the place as an array of shape (3,)."""
        return np.array([self.x, self.y, self.z])

    def __matmul__(self, child: Pose) -> Pose:
        """Compose: `child`, given in this pose's frame, seen from the fixed frame."""
        rotation = self.rotation()
        x, y, z = rotation @ child.translation() + self.translation()
        m = rotation @ child.rotation()
        pitch = math.asin(max(-1.0, min(1.0, -m[2, 0])))
        roll, yaw = math.atan2(m[2, 1], m[2, 2]), math.atan2(m[1, 0], m[0, 0])
        return Pose(float(x), float(y), float(z), roll, pitch, yaw)

    def bearing_to(self, x: float, y: float) -> float:
        """Return the horizontal bearing of a point in radians, positive to the left, in (-pi, pi]."""
        return wrap_angle(math.atan2(y - self.y, x - self.x) - self.yaw)

    def distance_to(self, x: float, y: float) -> float:
        """Return the horizontal distance to a point in metres."""
        return math.hypot(x - self.x, y - self.y)
