"""The safety gate: the last thing a command passes before the wire.

Pure: a function of the limits, the gate's state, the newest set-point and the time. What leaves it is finite,
inside the envelope and never further from the last output than the acceleration limits allow; the one
exception is a stop, which is zero at once. A stop latches: only a new `GateState` lets anything move again.
"""

from __future__ import annotations

import enum
import math
from dataclasses import dataclass, replace

from adatracker_deploy.platform import ZERO, Limits, Twist

FUTURE_TOLERANCE_S = 0.05
"""A set-point stamped further ahead than this would outlive its sender: it is treated as stale."""
LONGEST_STEP_S = 0.1
"""A pause of the gate itself must not let the next command jump."""


class Stage(enum.IntEnum):
    """How far the gate has gone from obeying; each stage includes the ones before."""

    OBEY = 0
    ZERO = 1
    """No fresh command: send zero, obey again when one comes."""
    HOLD = 2
    """Latched: hold."""
    DISENGAGE = 3
    """Latched and nobody has come back: give up control in the robot's safe way."""


@dataclass(frozen=True, slots=True)
class Setpoint:
    """A velocity that somebody asked for at clock time `t_ns`."""

    twist: Twist
    t_ns: int


@dataclass(frozen=True, slots=True)
class GateState:
    """What the gate remembers between two commands."""

    armed_ns: int
    """When it was armed: older set-points do not count."""
    last: Twist = ZERO
    last_ns: int = 0
    stopped: str = ""
    """Why a stop has latched; empty while none has."""


@dataclass(frozen=True, slots=True)
class Verdict:
    """What goes to the wire, and why it differs from what was asked."""

    twist: Twist
    stage: Stage
    reasons: tuple[str, ...] = ()


def judge(
    limits: Limits, state: GateState, setpoint: Setpoint | None, now_ns: int
) -> tuple[GateState, Verdict]:
    """Judge the newest set-point at `now_ns`; `setpoint` is None before the first."""
    if setpoint is None or setpoint.t_ns < state.armed_ns:
        setpoint = Setpoint(ZERO, state.armed_ns)
    age_s = (now_ns - setpoint.t_ns) / 1e9
    if age_s < -FUTURE_TOLERANCE_S:
        age_s = math.inf
    if age_s > limits.disengage_after_s:
        return _stop(state, now_ns, Stage.DISENGAGE, state.stopped or "command_lost")
    if state.stopped:
        return _stop(state, now_ns, Stage.HOLD, state.stopped)
    if not setpoint.twist.is_finite():
        return _stop(state, now_ns, Stage.HOLD, "not_finite")
    if age_s > limits.hold_after_s:
        return _stop(state, now_ns, Stage.HOLD, "command_lost")
    if age_s > limits.command_timeout_s:
        return replace(state, last=ZERO, last_ns=now_ns), Verdict(ZERO, Stage.ZERO, ("stale",))
    inside = _envelope(limits, setpoint.twist)
    dt_s = min(max((now_ns - state.last_ns) / 1e9, 0.0), LONGEST_STEP_S)
    smooth = _approach(limits, state.last, inside, dt_s)
    reasons = (("envelope",) if inside != setpoint.twist else ()) + (
        ("acceleration",) if smooth != inside else ()
    )
    return replace(state, last=smooth, last_ns=now_ns), Verdict(smooth, Stage.OBEY, reasons)


def _stop(state: GateState, now_ns: int, stage: Stage, reason: str) -> tuple[GateState, Verdict]:
    return replace(state, last=ZERO, last_ns=now_ns, stopped=reason), Verdict(ZERO, stage, (reason,))


def _envelope(limits: Limits, twist: Twist) -> Twist:
    return Twist(
        vx=min(max(twist.vx, -limits.backward_m_s), limits.forward_m_s),
        vy=_clip(twist.vy, limits.lateral_m_s),
        vz=_clip(twist.vz, limits.vertical_m_s),
        yaw_rate=_clip(twist.yaw_rate, limits.yaw_rate_rad_s),
    )


def _approach(limits: Limits, last: Twist, wanted: Twist, dt_s: float) -> Twist:
    """Move from `last` towards `wanted`; both are inside the envelope, which is convex, so the result is."""
    dvx, dvy = wanted.vx - last.vx, wanted.vy - last.vy
    change, allowed = math.hypot(dvx, dvy), limits.accel_m_s2 * dt_s
    share = 1.0 if change <= allowed else allowed / change
    return Twist(
        vx=wanted.vx if share == 1.0 else last.vx + share * dvx,
        vy=wanted.vy if share == 1.0 else last.vy + share * dvy,
        vz=_step(last.vz, wanted.vz, allowed),
        yaw_rate=_step(last.yaw_rate, wanted.yaw_rate, limits.yaw_accel_rad_s2 * dt_s),
    )


def _step(last: float, wanted: float, allowed: float) -> float:
    return wanted if abs(wanted - last) <= allowed else last + math.copysign(allowed, wanted - last)


def _clip(value: float, magnitude: float) -> float:
    return min(max(value, -magnitude), magnitude)
