"""Finds the reasons to latch a stop, in order of precedence, and the limits that cannot be monitored.

Comparisons are written so that a NaN stops.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from adatracker_deploy.config.limits import Limits
from adatracker_deploy.core.messages import PlatformState
from adatracker_deploy.runtime.gate.place import leaves_fence, strays
from adatracker_deploy.runtime.gate.reasons import Reason
from adatracker_deploy.runtime.gate.state import GateState, Setpoint, Stage, Stop

if TYPE_CHECKING:
    from collections.abc import Iterator


def stops(limits: Limits, state: GateState, robot: PlatformState, now_ns: int) -> Iterator[Stop]:
    """Yield every reason in the robot's state to stop it at `now_ns`."""
    if robot.stopped:
        yield Stop(Reason.TAKEOVER if robot.taken_over else Reason.ROBOT_STOPPED, robot.stopped)
    if not robot.engaged:
        yield Stop(Reason.NOT_ENGAGED)
    # A time in the future is as bad as an old one, and a state older than the last is not new.
    if abs(robot.age_s(now_ns)) > limits.state_timeout_s or robot.t_ns < state.heard_ns:
        yield from _unless_off(limits, Reason.STATE_LOST)
    if robot.battery is None and state.battery_told and Reason.BATTERY not in limits.switched_off:
        yield Stop(Reason.BATTERY_LOST)
    if robot.battery is not None and not robot.battery > limits.battery_stop:
        yield from _unless_off(limits, Reason.BATTERY, Stage.DISENGAGE)
    if robot.pose is None:
        if state.track is not None and _needs_position(limits):
            yield Stop(Reason.POSITION_LOST)
        return
    if state.track is not None and state.track.jumped:
        yield from _unless_off(limits, Reason.POSITION_JUMPED)
    if state.start and leaves_fence(limits, state.start, robot.pose, robot.velocity or state.last):
        yield from _unless_off(limits, Reason.GEOFENCE)
    if limits.altitude_m is not None and strays(limits.altitude_m, robot.pose.z):
        yield from _unless_off(limits, Reason.ALTITUDE)


def command_stops(limits: Limits, setpoint: Setpoint, silence_s: float) -> Iterator[Stop]:
    """Yield every reason in the newest set-point to stop, after `silence_s` without a fresh one."""
    if not setpoint.twist.is_finite():
        yield Stop(Reason.NOT_FINITE)
    if silence_s > limits.hold_after_s:
        yield Stop(Reason.COMMAND_LOST)


def warnings(limits: Limits, robot: PlatformState) -> tuple[Reason, ...]:
    """Return the reasons that are about to stop the robot."""
    low = robot.battery is not None and not robot.battery > limits.battery_warn
    return (Reason.BATTERY_LOW,) if low and Reason.BATTERY not in limits.switched_off else ()


def unmonitored(limits: Limits, robot: PlatformState) -> tuple[Reason, ...]:
    """Return the enabled limits that cannot be enforced because the robot does not report what they need."""
    missing = {
        Reason.GEOFENCE: robot.pose is None,
        Reason.ALTITUDE: robot.pose is None and limits.altitude_m is not None,
        Reason.BATTERY: robot.battery is None,
    }
    return tuple(reason for reason, lacks in missing.items() if lacks and reason not in limits.switched_off)


def _needs_position(limits: Limits) -> bool:
    """Return whether any enabled limit needs the robot's position."""
    fenced = Reason.GEOFENCE not in limits.switched_off
    return fenced or (limits.altitude_m is not None and Reason.ALTITUDE not in limits.switched_off)


def _unless_off(limits: Limits, reason: Reason, stage: Stage = Stage.HOLD) -> Iterator[Stop]:
    if reason not in limits.switched_off:
        yield Stop(reason, stage=stage)
