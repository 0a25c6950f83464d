"""Preflight checks of the quadruped, from its telemetry. Pure."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from adatracker_deploy.platform import Check
from adatracker_deploy.runtime.robot_clock import clocks_check

if TYPE_CHECKING:
    from adatracker_quadruped.protocol.connection import Connection

LARGEST_TILT_DEG = 30.0
"""Largest tilt; beyond it the robot lies down, or stands on a slope too steep to stop on."""
LEAST_IN_TIMEOUT = 3
"""Messages of odometry within its time-out: with fewer, one that is lost stops the robot."""
LONGEST_TIMEOUT_S = 1.0
"""nav2's velocity_smoother gives up after so long; diff_drive_controller after half of it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RobotTelemetry:
    """Telemetry gathered by a preflight."""

    command_key: str
    matched: bool
    """Somebody subscribes to the commands."""
    has_rival: bool
    """Another host holds the token."""
    trouble: str
    """Result of `monitor.RobotMonitor.trouble`."""
    odometry_hz: float
    attitude: tuple[float, float, float] | None
    """Roll, pitch and yaw, rad, from the IMU, or from the odometry where there is no IMU topic."""
    battery: float | None
    """State of charge, 0 to 1; None if the robot does not tell it."""
    camera_key: str
    """Empty when the camera is not the robot's."""
    camera_heard: bool
    clock_ahead_s: float | None = None
    """By its odometry's stamps, as `robot_clock.clock_ahead_s` returns it."""
    dropped: int
    """Messages that were malformed."""


def judge(heard: RobotTelemetry, connection: Connection) -> tuple[Check, ...]:
    """Return all checks, including those that pass."""
    checks = (
        _commands(heard),
        _lease(heard, connection),
        _odometry(heard, connection),
        _upright(heard),
        _battery(heard, connection),
        _own_timeout(connection),
        *((clocks_check(heard.clock_ahead_s),) if connection.command == "twist_stamped" else ()),
        *((_camera(heard),) if heard.camera_key else ()),
    )
    if heard.dropped:
        told = f"{heard.dropped} malformed or repeated messages were dropped: check each topic's type"
        return (*checks, Check("messages", ok=False, message=told, blocking=False))
    return checks


def _commands(heard: RobotTelemetry) -> Check:
    if heard.matched:
        return Check("command topic", ok=True, message=f"somebody subscribes to {heard.command_key}")
    return Check(
        "command topic",
        ok=False,
        message=f"nobody subscribes to {heard.command_key}: start the robot's velocity node, or correct "
        "connection.command, command_topic, namespace or dialect",
    )


def _lease(heard: RobotTelemetry, connection: Connection) -> Check:
    if not heard.has_rival:
        return Check("only host", ok=True, message=f"no other host holds {connection.host_token}")
    return Check(
        "only host",
        ok=False,
        message=f"another host holds {connection.host_token}: end the program that walks this robot first",
    )


def _odometry(heard: RobotTelemetry, connection: Connection) -> Check:
    least_hz = LEAST_IN_TIMEOUT / connection.odometry_timeout_s
    ok = not heard.trouble and heard.odometry_hz >= least_hz
    found = heard.trouble or f"{heard.odometry_hz:.0f} Hz"
    return Check("odometry", ok, found if ok else f"{found}; at least {least_hz:.0f} Hz are needed")


def _upright(heard: RobotTelemetry) -> Check:
    if heard.attitude is None:
        return Check("upright", ok=False, message="no attitude was heard: check connection.imu_topic")
    roll, pitch, _ = heard.attitude
    tilt_deg = math.degrees(math.acos(math.cos(roll) * math.cos(pitch)))
    ok = tilt_deg <= LARGEST_TILT_DEG
    mend = "" if ok else f", more than {LARGEST_TILT_DEG:g}: stand the robot up on level ground"
    return Check("upright", ok, f"leans by {tilt_deg:.0f} degrees{mend}")


def _battery(heard: RobotTelemetry, connection: Connection) -> Check:
    least = connection.min_battery
    if heard.battery is None:
        mend = "" if least == 0 else ": name connection.battery_topic, or set min_battery to 0 to go without"
        return Check("battery", ok=least == 0, message=f"the robot does not report its charge{mend}")
    ok = heard.battery >= least
    return Check(
        "battery", ok, f"{heard.battery:.0%}" + ("" if ok else f"; charge it to {least:.0%} at least")
    )


def _own_timeout(connection: Connection) -> Check:
    timeout_s = connection.command_timeout_s
    ok = timeout_s <= LONGEST_TIMEOUT_S
    return Check(
        "command time-out",
        ok,
        f"the profile says that the robot stops by itself {timeout_s:g} s after the last command"
        + (
            "; no message reports it, so see it stop once, held up by hand"
            if ok
            else f": set it to {LONGEST_TIMEOUT_S:g} s or less on the robot, then in the profile"
        ),
    )


def _camera(heard: RobotTelemetry) -> Check:
    found = "images come on" if heard.camera_heard else "no image came on"
    return Check("camera topic", heard.camera_heard, f"{found} {heard.camera_key}", blocking=False)
