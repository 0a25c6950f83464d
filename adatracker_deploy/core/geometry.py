"""Poses and angles: the one place where frames are composed.

Frames follow ROS REP 103: fixed frames are x east (or any), y to its left, z up; body frames are x forward,
y left, z up; yaw is counter-clockwise seen from above. Angles are radians, lengths metres.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Matrix = NDArray[np.float64]

UNIT_TOLERANCE = 10e-3
"""Tolerance of a quaternion's squared length: tf2's (QUATERNION_NORMALIZATION_TOLERANCE)."""


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


class Quaternion(NamedTuple):
    """An orientation as messages carry it; of unit length."""

    w: float
    x: float
    y: float
    z: float

    @classmethod
    def of(cls, roll: float, pitch: float, yaw: float) -> Quaternion:
        """Return the quaternion of Rz(yaw) Ry(pitch) Rx(roll), which is what `Pose` means."""
        cr, sr = math.cos(roll / 2), math.sin(roll / 2)
        cp, sp = math.cos(pitch / 2), math.sin(pitch / 2)
        cy, sy = math.cos(yaw / 2), math.sin(yaw / 2)
        return cls(
            w=cr * cp * cy + sr * sp * sy,
            x=sr * cp * cy - cr * sp * sy,
            y=cr * sp * cy + sr * cp * sy,
            z=cr * cp * sy - sr * sp * cy,
        )

    def roll_pitch_yaw(self) -> tuple[float, float, float]:
        """Return roll, pitch and yaw, rad, as `Pose` means them.

        Raises:
            ValueError: it is not of unit length, or not finite.
        """
        w, x, y, z = self
        square = x * x + y * y + z * z + w * w
        if not abs(square - 1.0) < UNIT_TOLERANCE:  # false for NaN too
            raise ValueError(f"quaternion ({x:g}, {y:g}, {z:g}, {w:g}) is not of unit length")
        roll = math.atan2(2 * (w * x + y * z), w * w - x * x - y * y + z * z)
        pitch = math.asin(max(-1.0, min(1.0, 2 * (w * y - z * x) / square)))
        yaw = math.atan2(2 * (w * z + x * y), w * w + x * x - y * y - z * z)
        return roll, pitch, yaw
