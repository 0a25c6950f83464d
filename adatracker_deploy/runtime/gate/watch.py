"""What stops the robot for good, in the order in which it is told, and what cannot be watched at all.

Comparisons are written so that a measurement that is not a number stops.
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
    """Give every reason that the robot is for stopping it at `now_ns`."""
    if robot.stopped:
        yield Stop(Reason.TAKEOVER if robot.taken_over else Reason.ROBOT_STOPPED, robot.stopped)
    if not robot.engaged:
        yield Stop(Reason.NOT_ENGAGED)
    # From the future is no better than old, and older than what was heard before is no news.
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
    """Give every reason to stop that the newest set-point is, after `silence_s` without a fresh one."""
    if not setpoint.twist.is_finite():
        yield Stop(Reason.NOT_FINITE)
    if silence_s > limits.hold_after_s:
        yield Stop(Reason.COMMAND_LOST)


def warnings(limits: Limits, robot: PlatformState) -> tuple[Reason, ...]:
    """Return what is about to stop the robot."""
    low = robot.battery is not None and not robot.battery > limits.battery_warn
    return (Reason.BATTERY_LOW,) if low and Reason.BATTERY not in limits.switched_off else ()


def unmonitored(limits: Limits, robot: PlatformState) -> tuple[Reason, ...]:
    """Return the limits that are on but cannot be kept, for the robot does not tell what they need."""
    missing = {
        Reason.GEOFENCE: robot.pose is None,
        Reason.ALTITUDE: robot.pose is None and limits.altitude_m is not None,
        Reason.BATTERY: robot.battery is None,
    }
    return tuple(reason for reason, lacks in missing.items() if lacks and reason not in limits.switched_off)


def _needs_position(limits: Limits) -> bool:
    """Tell whether any limit that is on is about where the robot is."""
    fenced = Reason.GEOFENCE not in limits.switched_off
    return fenced or (limits.altitude_m is not None and Reason.ALTITUDE not in limits.switched_off)


def _unless_off(limits: Limits, reason: Reason, stage: Stage = Stage.HOLD) -> Iterator[Stop]:
    if reason not in limits.switched_off:
        yield Stop(reason, stage=stage)
