"""Preflight checks before enabling a base, from its telemetry. Pure."""

from __future__ import annotations

from typing import TYPE_CHECKING

from adatracker_deploy.platform import Check

if TYPE_CHECKING:
    from adatracker_wheeled.adapter.receiver import BaseTelemetry, StopCause
    from adatracker_wheeled.protocol.roles import Timing

NOT_OURS = (
    "the base is enabled already, and not by a run of yours that was killed: end the program that commands "
    "it, or put the base into standby with its transmitter or by switching it off and on"
)
LONGEST_QUEUE = 10
"""Frames that the kernel may keep for a stalled bus; on recovery they all go out, however old."""


def status_checks(heard: BaseTelemetry, timing: Timing, now_ns: int, speed: float) -> tuple[Check, ...]:
    """Judge the base's own report; ages are in machine time, `speed` is the clock's."""
    status = heard.status
    age_s = (now_ns - heard.status_t_ns) / 1e9 / speed
    if status is None or age_s > timing.state_timeout_s:
        return (Check("state", False, f"no new state for {age_s:.1f} s: is the base still on?"),)
    pressed, driven = status.emergency_stop, status.mode == "remote"
    motion_age_s = (now_ns - heard.motion_t_ns) / 1e9 / speed
    alive = motion_age_s <= timing.feedback_timeout_s
    return (
        Check("state", True, f"{status.mode_name}{_volts(status.volts)}"),
        Check(
            "emergency stop",
            not pressed,
            "pressed: release it where the base stands" if pressed else "released",
        ),
        Check(
            "faults",
            not status.fault,
            f"the base reports: {status.fault}; fix it and clear its errors" if status.fault else "none",
        ),
        Check(
            "warnings",
            not status.warning,
            f"the base warns of: {status.warning}" if status.warning else "none",
            blocking=False,
        ),
        Check(
            "remote control",
            not driven,
            "somebody drives: switch the transmitter to command mode" if driven else "does not drive",
        ),
        Check(
            "feedback",
            alive,
            f"measured motion comes, wanted every {timing.feedback_period_s * 1e3:g} ms"
            if alive
            else "no measured motion: check the feedback role against the base's manual",
        ),
    )


def control_check(
    heard: BaseTelemetry, rival: StopCause | None, in_charge: bool, left_by: int | None
) -> Check:
    """Judge who commands the base.

    Args:
        heard: of the base.
        rival: somebody else who was heard to command it lately.
        in_charge: this adapter has enabled it.
        left_by: an ended process of this user's that had enabled it and never disabled it.
    """
    if rival is not None:
        return Check("control", False, rival.reason)
    if heard.status is None or heard.status.mode != "ours" or in_charge:
        return Check("control", True, "nobody else commands the base")
    if left_by is None:
        return Check("control", False, NOT_OURS)
    told = f"process {left_by} left the base enabled when it was killed; it is taken back through standby"
    return Check("control", True, told)


def battery_check(battery: float | None, needed: float) -> Check:
    """Judge the charge."""
    charge = "an unknown charge" if battery is None else f"{battery:.0%}"
    ok = needed == 0 or (battery or 0.0) >= needed
    return Check("battery", ok, f"{charge} left, {needed:.0%} needed to drive")


def timeout_check(timing: Timing) -> Check:
    """Remind of what cannot be queried over CAN: that the base stops by itself."""
    return Check(
        "command time-out",
        True,
        f"the profile says that the base stops {timing.base_timeout_s:g} s after the last command; "
        "CAN does not report it, so test it once with the wheels off the ground",
    )


def frames_check(malformed: int) -> Check:
    """Warn of malformed frames."""
    return Check(
        "frames",
        not malformed,
        f"{malformed} malformed frames were dropped: check the cable and roles.dbc" if malformed else "whole",
        blocking=False,
    )


def queue_check(channel: str, length: int) -> Check:
    """Warn of a kernel that would keep old commands for a stalled bus."""
    fix = "" if length <= LONGEST_QUEUE else f"sudo ip link set {channel} txqueuelen {LONGEST_QUEUE}"
    told = f"{length} frames{': ' if fix else ''}{fix}"
    return Check("transmit queue", not fix, told, blocking=False, fix=fix)


def _volts(volts: float | None) -> str:
    return "" if volts is None else f", {volts:.1f} V"
