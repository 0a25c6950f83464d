"""Preflight checks of a ROS 2 robot, from its telemetry. Pure."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from adatracker_deploy.platform import Check
from adatracker_deploy.runtime.robot_clock import clocks_check

if TYPE_CHECKING:
    from adatracker_deploy.core.camera_info import CameraInfo
    from adatracker_ros2.protocol.connection import Connection

LEAST_IN_TIMEOUT = 3
"""Messages of odometry within its time-out: with fewer, one that is lost stops the robot."""
LONGEST_TIMEOUT_S = 1.0
"""nav2's velocity_smoother gives up after so long; diff_drive_controller after half of it."""
_SAME_S = 0.01
"""Time-outs that differ by less are the same."""
_SAME_DEG = 2.0
"""Fields of view that differ by less are the same: data sheets round them."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RobotTelemetry:
    """Telemetry gathered by a preflight."""

    command_topic: str
    matched: bool
    """Somebody subscribes to the commands."""
    rival: str
    """Others that publish commands, as `ownership.Ownership.rival` returns them."""
    trouble: str
    """Result of `monitor.RobotMonitor.trouble`."""
    odometry_hz: float
    battery: float | None
    """State of charge, 0 to 1; None if the robot does not tell it."""
    timeout_s: float | None
    """The driver's own time-out; None if it was not asked or did not answer."""
    state: str | None
    """The driver's lifecycle state; None likewise."""
    camera_topic: str
    """Empty when the camera is not the robot's."""
    camera_there: bool
    camera_info_topic: str = ""
    """Empty when nobody publishes it."""
    camera_info_came: bool = False
    lens: CameraInfo | None = None
    """By camera_info; None if it did not come, or says that the camera is not calibrated."""
    clock_ahead_s: float | None = None
    """By its odometry's stamps, as `robot_clock.clock_ahead_s` returns it."""
    dropped: int
    """Messages that were malformed."""


def judge(heard: RobotTelemetry, connection: Connection, fov_deg: float | None = None) -> tuple[Check, ...]:
    """Return all checks, including those that pass.

    Args:
        heard: from the robot.
        connection: the profile's.
        fov_deg: the camera's field of view by the profile; None where it does not tell it.
    """
    checks = (
        _commands(heard),
        _publisher(heard),
        _odometry(heard, connection),
        _battery(heard, connection),
        _told_timeout(heard, connection) if connection.timeout_parameter else _own_timeout(connection),
        *((clocks_check(heard.clock_ahead_s),) if connection.command == "twist_stamped" else ()),
        *((_lifecycle(heard, connection),) if connection.lifecycle else ()),
        *((_camera(heard),) if heard.camera_topic else ()),
        *((_lens(heard, fov_deg),) if heard.camera_info_topic else ()),
    )
    if heard.dropped:
        told = (
            f"{heard.dropped} malformed or repeated messages were dropped: look at them with ros2 topic echo"
        )
        return (*checks, Check("messages", ok=False, message=told, blocking=False))
    return checks


def _commands(heard: RobotTelemetry) -> Check:
    if heard.matched:
        return Check("command topic", ok=True, message=f"somebody subscribes to {heard.command_topic}")
    return Check(
        "command topic",
        ok=False,
        message=f"nobody subscribes to {heard.command_topic}: start the robot's driver, or correct "
        "connection.command_topic, namespace or domain",
    )


def _publisher(heard: RobotTelemetry) -> Check:
    if not heard.rival:
        return Check("only publisher", ok=True, message=f"nobody else publishes to {heard.command_topic}")
    return Check("only publisher", ok=False, message=f"{heard.rival}: end that node first")


def _odometry(heard: RobotTelemetry, connection: Connection) -> Check:
    least_hz = LEAST_IN_TIMEOUT / connection.odometry_timeout_s
    ok = not heard.trouble and heard.odometry_hz >= least_hz
    found = heard.trouble or f"{heard.odometry_hz:.0f} Hz"
    return Check("odometry", ok, found if ok else f"{found}; at least {least_hz:.0f} Hz are needed")


def _battery(heard: RobotTelemetry, connection: Connection) -> Check:
    least = connection.min_battery
    if heard.battery is None:
        mend = "" if least == 0 else ": name connection.battery_topic, or set min_battery to 0 to go without"
        return Check("battery", ok=least == 0, message=f"the robot does not report its charge{mend}")
    ok = heard.battery >= least
    return Check(
        "battery", ok, f"{heard.battery:.0%}" + ("" if ok else f"; charge it to {least:.0%} at least")
    )


def _told_timeout(heard: RobotTelemetry, connection: Connection) -> Check:
    """Judge the time-out that the driver tells; the profile must say the same."""
    where = f"{connection.timeout_parameter} of {connection.driver_node}"
    told_s, said_s = heard.timeout_s, connection.command_timeout_s
    if told_s is None:
        return Check(
            "command time-out",
            ok=False,
            message=f"{where} is unknown: start that node, or correct driver_node and timeout_parameter",
        )
    if not 0 < told_s <= LONGEST_TIMEOUT_S:  # false for NaN too
        mend = f"set it to {LONGEST_TIMEOUT_S:g} s or less, and above 0"
        return Check("command time-out", ok=False, message=f"{where} is {told_s:g} s: {mend}")
    if abs(told_s - said_s) > _SAME_S:
        return Check(
            "command time-out",
            ok=False,
            message=f"{where} is {told_s:g} s, but command_timeout_s is {said_s:g} here: correct one",
        )
    return Check("command time-out", ok=True, message=f"{where} is {told_s:g} s")


def _own_timeout(connection: Connection) -> Check:
    timeout_s = connection.command_timeout_s
    ok = timeout_s <= LONGEST_TIMEOUT_S
    return Check(
        "command time-out",
        ok,
        f"the profile says that the robot stops by itself {timeout_s:g} s after the last command"
        + (
            "; name timeout_parameter if its driver has one, and see it stop once, wheels off the ground"
            if ok
            else f": set it to {LONGEST_TIMEOUT_S:g} s or less on the robot, then in the profile"
        ),
    )


def _lifecycle(heard: RobotTelemetry, connection: Connection) -> Check:
    if heard.state == "active":
        return Check("driver", ok=True, message=f"{connection.driver_node} is active")
    found = f"is {heard.state}" if heard.state else "does not report its state"
    return Check(
        "driver",
        ok=False,
        message=f"{connection.driver_node} {found}: ros2 lifecycle set {connection.driver_node} activate",
    )


def _camera(heard: RobotTelemetry) -> Check:
    found = "somebody publishes" if heard.camera_there else "nobody publishes"
    return Check("camera topic", heard.camera_there, f"{found} to {heard.camera_topic}", blocking=False)


def _lens(heard: RobotTelemetry, said_deg: float | None) -> Check:
    """Compare the lens with the profile's; a policy needs neither, so it never blocks."""
    where = heard.camera_info_topic
    if heard.lens is None:
        if heard.camera_info_came:
            return Check("lens", ok=True, message=f"{where} says that the camera is not calibrated")
        told = (
            f"{where} is there, but no valid sensor_msgs/CameraInfo came: see ros2 topic echo --once {where}"
        )
        return Check("lens", ok=False, message=told, blocking=False)
    found_deg = math.degrees(heard.lens.fov_rad)
    seen = f"{found_deg:.0f} degrees by {where} (fx {heard.lens.fx:.0f} of {heard.lens.width_px} px)"
    if said_deg is not None and abs(said_deg - found_deg) > _SAME_DEG:
        told = f"camera.fov_deg is {said_deg:g} in the profile, but {seen}: correct one, or leave it out"
        return Check("lens", ok=False, message=told, blocking=False)
    return Check("lens", ok=True, message=seen)
