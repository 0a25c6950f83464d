"""Turns a fresh command into the velocity that is sent."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

from adatracker_deploy.config.limits import Limits
from adatracker_deploy.core.messages import PlatformState, Twist
from adatracker_deploy.runtime.gate.envelope import Envelope, narrowed
from adatracker_deploy.runtime.gate.reasons import Reason
from adatracker_deploy.runtime.gate.state import GateState

if TYPE_CHECKING:
    from collections.abc import Iterable

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


def move(
    limits: Limits, state: GateState, asked: Twist, robot: PlatformState, dt_s: float
) -> tuple[GateState, tuple[Reason, ...]]:
    """Move from the last velocity towards the requested one; return the next state and the reasons for
    changes.

    The request is clipped to every envelope, then smoothed. Smoothing stays inside an envelope that does not
    shrink. One that has shrunk (the target is too close, the edge of the altitude band is reached) cuts its
    axis at once, without smoothing, as a stop does.

    Args:
        limits: the profile's.
        state: with `last_ns` the time now.
        asked: the requested velocity, finite.
        robot: the robot's newest state.
        dt_s: time since the last velocity was sent, s.
    """
    narrow = narrowed(limits, state, robot, state.last_ns)
    wanted, reasons = _clip(asked, narrow)
    eased, _ = smooth(limits, state.last, state.rate, wanted, dt_s, jerk=False)
    jerk = Reason.JERK not in limits.switched_off
    smoothed, rate = smooth(limits, state.last, state.rate, wanted, dt_s, jerk=jerk)
    _, (_, ramp), *sudden = narrow
    out, cut = _clip(ramp.clip(smoothed), sudden)  # the first clip removes rounding errors
    rate = replace(
        rate, vx=rate.vx if out.vx == smoothed.vx else 0.0, vz=rate.vz if out.vz == smoothed.vz else 0.0
    )
    changed = {
        **dict.fromkeys(reasons, True),
        **dict.fromkeys(cut, True),
        Reason.ACCELERATION: eased != wanted,
        Reason.JERK: smoothed != eased,
    }
    return replace(state, last=out, rate=rate), tuple(reason for reason, is_so in changed.items() if is_so)


def _clip(twist: Twist, narrow: Iterable[tuple[Reason, Envelope]]) -> tuple[Twist, list[Reason]]:
    """Clip a velocity to one envelope after the other; return it and the reasons."""
    reasons = []
    for reason, envelope in narrow:
        before, twist = twist, envelope.clip(twist)
        if twist != before:
            reasons.append(reason)
    return twist, reasons
