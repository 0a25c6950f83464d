"""Limits acceleration and jerk."""

from __future__ import annotations

import math

from adatracker_deploy.config.limits import Limits
from adatracker_deploy.core.messages import Twist

ARRIVED = 1e-9
"""A speed this close to the wanted one, m/s or rad/s, counts as reached."""


def approach(
    speed: float, rate: float, wanted: float, dt_s: float, *, accel: float, jerk: float
) -> tuple[float, float]:
    """Move a speed towards the wanted one for `dt_s` seconds; return it and its new rate of change.

    The rate aimed at is the largest from which the speed can still settle at `wanted`. A rate `r` that falls
    by `jerk` adds ``r^2 / (2 jerk)`` to the speed until it is zero, and this step adds ``r dt``: `aim` is the
    root of ``r dt + r^2 / (2 jerk) = error``. A falling rate that is applied from the start of each step adds
    less than that integral, however long the steps; so the speed never exceeds a bound that every `wanted`
    respects. If a new `wanted` comes too late, the speed overshoots it by at most ``accel^2 / (2 jerk)`` and
    comes back.

    Args:
        speed: the current speed, m/s or rad/s.
        rate: its rate of change over the last step, at most `accel`.
        wanted: the speed to reach.
        dt_s: the step, s, not negative; over a step of 0 nothing changes.
        accel: the largest rate, positive.
        jerk: the largest change of the rate per second, positive; infinite for no such limit.
    """
    if dt_s == 0:
        return speed, rate
    error = wanted - speed
    reachable = 2 * abs(error) / (dt_s + math.sqrt(dt_s**2 + 2 * abs(error) / jerk))
    aim = math.copysign(min(accel, reachable), error)
    most = jerk * dt_s
    rate += min(max(aim - rate, -most), most)
    after = speed + rate * dt_s
    return (wanted if abs(wanted - after) < ARRIVED else after), rate


def smooth(
    limits: Limits, last: Twist, rate: Twist, wanted: Twist, dt_s: float, *, jerk: bool
) -> tuple[Twist, Twist]:
    """Move a velocity towards the wanted one for `dt_s` seconds; return it and its new rate of change.

    A robot that also moves sideways shares acceleration and jerk between both axes, so that the horizontal
    vector keeps the limits in every direction.

    Args:
        limits: the profile's, with acceleration and jerk.
        last: the current velocity.
        rate: its rate of change over the last step.
        wanted: the velocity to reach.
        dt_s: the step, s, not negative.
        jerk: whether jerk is limited.
    """
    share = math.sqrt(0.5) if limits.lateral_m_s else 1.0
    accel, yaw_accel = limits.accel_m_s2, limits.yaw_accel_rad_s2
    most, yaw_most = (limits.jerk_m_s3, limits.yaw_jerk_rad_s3) if jerk else (math.inf, math.inf)
    level, level_most = share * accel, share * most
    vx, ax = approach(last.vx, rate.vx, wanted.vx, dt_s, accel=level, jerk=level_most)
    vy, ay = approach(last.vy, rate.vy, wanted.vy, dt_s, accel=level, jerk=level_most)
    vz, az = approach(last.vz, rate.vz, wanted.vz, dt_s, accel=accel, jerk=most)
    turn, spin = approach(last.yaw_rate, rate.yaw_rate, wanted.yaw_rate, dt_s, accel=yaw_accel, jerk=yaw_most)
    return Twist(vx, vy, vz, turn), Twist(ax, ay, az, spin)
