"""Judges a command, in this order: is there a stop, is it fresh, is it within limits, is it smooth."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import chain

from adatracker_deploy.config.limits import Limits
from adatracker_deploy.core.messages import ZERO, PlatformState
from adatracker_deploy.runtime.gate.envelope import nearing
from adatracker_deploy.runtime.gate.monitor import command_stops, stops, warnings
from adatracker_deploy.runtime.gate.move import move
from adatracker_deploy.runtime.gate.reasons import Reason
from adatracker_deploy.runtime.gate.state import GateState, Setpoint, Stage, Stop, Verdict
from adatracker_deploy.runtime.gate.track import follow

LONGEST_STEP_S = 0.1
"""Longest time step, s: a pause of the gate itself must not let the next command jump."""


def judge(
    limits: Limits, state: GateState, setpoint: Setpoint | None, robot: PlatformState, now_ns: int
) -> tuple[GateState, Verdict]:
    """Judge the newest set-point at `now_ns`.

    Args:
        limits: the profile's, with its time-outs in the run's clock.
        state: the state last returned, or a new one after engaging.
        setpoint: the newest; None before the first. One from before arming is ignored. One stamped more than
            `command_timeout_s` ahead would outlive its sender and is discarded.
        robot: the robot's newest state.
        now_ns: the run's clock; if it runs backwards, time stands still here.
    """
    before_ns = max(state.last_ns, state.armed_ns)
    now_ns = max(now_ns, before_ns)
    pause_s = (now_ns - before_ns) / 1e9
    if setpoint is None or setpoint.t_ns < state.armed_ns:
        setpoint = Setpoint(ZERO, state.armed_ns)
    age_s = (now_ns - setpoint.t_ns) / 1e9
    if age_s < -limits.command_timeout_s:
        age_s = math.inf
    silence_s = max(age_s, pause_s)  # a gate that did not judge let nothing pass, however fresh it is now
    warned = warnings(limits, robot)
    state = _heard(limits, state, robot, now_ns)
    state = nearing(limits, state, setpoint, now_ns)
    stop = state.stop or next(
        chain(stops(limits, state, robot, now_ns), command_stops(limits, setpoint, silence_s)), None
    )
    if silence_s > limits.disengage_after_s:
        stop = replace(stop or Stop(Reason.COMMAND_LOST), stage=Stage.DISENGAGE)
    if stop is not None:
        still = replace(state, last=ZERO, rate=ZERO, stop=stop)
        return still, Verdict(ZERO, stop.stage, (stop.reason,), warned)
    if late := _too_old(limits, setpoint, age_s, now_ns):
        still = replace(state, last=ZERO, rate=ZERO)
        return still, Verdict(ZERO, Stage.ZERO, (late,), warned)
    if state.moving_ns is None and setpoint.twist != ZERO:
        state = replace(state, moving_ns=now_ns)
    dt_s = min(pause_s, LONGEST_STEP_S)
    state, reasons = move(limits, state, setpoint.twist, robot, dt_s)
    return state, Verdict(state.last, Stage.OBEY, reasons, warned)


def _heard(limits: Limits, state: GateState, robot: PlatformState, now_ns: int) -> GateState:
    """Remember which measurements the robot has sent, to notice when one is missing."""
    return replace(
        state,
        last_ns=now_ns,
        start=state.start or robot.pose,
        track=follow(limits, state.track, robot.pose, now_ns),
        heard_ns=max(state.heard_ns, robot.t_ns),
        battery_told=state.battery_told or robot.battery is not None,
    )


def _too_old(limits: Limits, setpoint: Setpoint, age_s: float, now_ns: int) -> Reason | None:
    """Return what is too old: the command, the frame that it is based on, or the hold of the dead-man button.

    Both times are of one machine's clock: a frame from the future has a wrong time, and may be older.
    """
    if age_s > limits.command_timeout_s:
        return Reason.STALE
    if setpoint.seen_ns is not None and not 0 <= (now_ns - setpoint.seen_ns) / 1e9 <= limits.sight_timeout_s:
        return Reason.BLIND
    if setpoint.held_until_ns is not None and now_ns >= setpoint.held_until_ns:
        return Reason.DEAD_MAN
    return None
