"""Geofence and altitude band: where the robot is and where it would come to rest.

A position of NaN is outside of everything.
"""

from __future__ import annotations

import math

from adatracker_deploy.config.limits import Limits, encloses
from adatracker_deploy.core.geometry import Pose
from adatracker_deploy.core.messages import Twist
from adatracker_deploy.runtime.gate.braking import stopping_s

STRAY_M = 0.5
"""This far outside the altitude band, m, steering back is no longer trusted: a stop latches."""


def leaves_fence(limits: Limits, start: Pose, pose: Pose, velocity: Twist) -> bool:
    """Return whether a robot stopped now would come to rest outside the fence.

    Args:
        limits: with the fence, in the frame of `start`: x ahead, y left.
        start: the pose where it was engaged.
        pose: its current pose.
        velocity: in its body frame.
    """
    stop_s = stopping_s(limits, math.hypot(velocity.vx, velocity.vy))
    forth, left = _turned(velocity.vx * stop_s, velocity.vy * stop_s, pose.yaw)
    x, y = _turned(pose.x + forth - start.x, pose.y + left - start.y, -start.yaw)
    if limits.fence_corners_m:
        return not encloses(limits.fence_corners_m, x, y)
    return not math.hypot(x, y) <= limits.fence_radius_m


def rest_height_m(limits: Limits, pose: Pose, velocity: Twist) -> float:
    """Return the height at which a vertical motion stopped now would end."""
    return pose.z + velocity.vz * stopping_s(limits, abs(velocity.vz))


def strays(band_m: tuple[float, float], height_m: float) -> bool:
    """Return whether a height is too far outside the altitude band."""
    low, high = band_m
    return not low - STRAY_M <= height_m <= high + STRAY_M


def _turned(x: float, y: float, angle_rad: float) -> tuple[float, float]:
    if math.isinf(angle_rad):  # infinity has no cosine
        return math.nan, math.nan
    cos, sin = math.cos(angle_rad), math.sin(angle_rad)
    return cos * x - sin * y, sin * x + cos * y
