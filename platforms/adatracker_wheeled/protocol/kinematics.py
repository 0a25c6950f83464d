"""Converts a body velocity to wheel speeds or a steering angle, and back: planar kinematics. Pure.

Quantities go by the names of `roles`, wheels as the speed of their rim in m/s. Positive yaw and steering
are to the left (REP 103).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from adatracker_deploy.core.messages import Twist
from adatracker_wheeled.protocol.roles import Steering, Wheels

CREEP_M_S = 0.01
"""Slower than this a base that steers like a car turns nothing, and its wheels are kept straight."""


@dataclass(frozen=True, slots=True)
class Drive:
    """The geometry of a base, as far as it is known."""

    wheels: Wheels | None = None
    steering: Steering | None = None

    def quantities(self, twist: Twist) -> dict[str, float]:
        """Return all that this geometry can say of a velocity.

        Wheel speeds are v -+ yaw_rate x track / 2 (differential drive). A steering angle beyond its largest
        is clipped, which makes the turn wider and keeps the speed.
        """
        said = {"vx_m_s": twist.vx, "vy_m_s": twist.vy, "yaw_rate_rad_s": twist.yaw_rate}
        if self.wheels is not None:
            half = twist.yaw_rate * self.wheels.track_m / 2
            said |= {"left_m_s": twist.vx - half, "right_m_s": twist.vx + half}
        if self.steering is not None:
            turns = abs(twist.vx) >= CREEP_M_S
            said["steering_rad"] = _angle(self.steering, twist.yaw_rate / twist.vx) if turns else 0.0
        return said

    def twist(self, said: dict[str, float]) -> Twist:
        """Return the velocity that wheel speeds, a steering angle or the velocity itself amount to."""
        if "left_m_s" in said and self.wheels is not None:
            left, right = said["left_m_s"], said["right_m_s"]
            return Twist(vx=(left + right) / 2, yaw_rate=(right - left) / self.wheels.track_m)
        vx = said["vx_m_s"]
        if "steering_rad" in said and self.steering is not None:
            return Twist(vx=vx, yaw_rate=vx * _curvature(self.steering, said["steering_rad"]))
        return Twist(vx=vx, vy=said.get("vy_m_s", 0.0), yaw_rate=said["yaw_rate_rad_s"])


def _angle(steering: Steering, curvature_1_m: float) -> float:
    """Return the angle of the inner front wheel on a circle: tan a = L / (R - t / 2), clipped to the largest.

    Ackermann's geometry, R measured to the middle of the rear axle; with t = 0 the bicycle model.
    """
    bend = abs(curvature_1_m)
    angle = math.atan2(steering.wheelbase_m * bend, 1 - bend * steering.inner_track_m / 2)
    return math.copysign(min(angle, steering.max_angle_rad), curvature_1_m)


def _curvature(steering: Steering, angle_rad: float) -> float:
    """Return 1 / R, the inverse of `_angle`."""
    slope = math.tan(abs(angle_rad))
    return math.copysign(slope / (steering.wheelbase_m + slope * steering.inner_track_m / 2), angle_rad)
