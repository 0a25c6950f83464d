"""Preflight checks before arming, from telemetry and parameters. Pure."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING

from adatracker_deploy.config.limits import Limits
from adatracker_deploy.platform import Check

if TYPE_CHECKING:
    from collections.abc import Callable

LOSS_ACTIONS = {
    0: "position mode",
    1: "altitude mode",
    2: "stabilized mode",
    3: "return",
    4: "land",
    5: "hold",
    6: "terminate",
    7: "disarm",
}
"""PX4's COM_OBL_RC_ACT."""
SAFE_LOSS_ACTIONS = (4, 5)
"""Actions that need neither a pilot nor a clear way home."""
LONGEST_LOSS_S = 1.0
"""PX4's default of COM_OF_LOSS_T."""
STOPPING_FENCE_ACTIONS = (2, 3, 4, 5)
"""PX4's GF_ACTION: hold, return, terminate, land; 0 does nothing, 1 warns."""
OVERRIDE_IN_OFFBOARD = 2
"""Bit of COM_RC_OVERRIDE: the pilot's sticks end OFFBOARD."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Parameters:
    """PX4's parameters that a preflight looks at; None where this autopilot has no such parameter."""

    COM_OF_LOSS_T: float | None = None
    COM_OBL_RC_ACT: float | None = None
    COM_RC_OVERRIDE: float | None = None
    GF_ACTION: float | None = None
    GF_MAX_HOR_DIST: float | None = None
    GF_MAX_VER_DIST: float | None = None
    MPC_XY_VEL_MAX: float | None = None
    MPC_Z_VEL_MAX_UP: float | None = None
    MPC_Z_VEL_MAX_DN: float | None = None
    NAV_MC_ALT_RAD: float | None = None
    MC_YAWRATE_MAX: float | None = None
    """deg/s."""

    @classmethod
    def read(cls, parameter: Callable[[str, type[int] | type[float]], float | None]) -> Parameters:
        """Ask for each by its name and PX4's type."""
        whole = {"COM_OBL_RC_ACT", "COM_RC_OVERRIDE", "GF_ACTION"}
        return cls(
            **{
                field.name: parameter(field.name, int if field.name in whole else float)
                for field in fields(cls)
            }
        )


def link_checks(url: str, signing_key: str, ignored: str, *, blocking: bool = False) -> tuple[Check, ...]:
    """Check who else could talk to this side; warnings only, because the network's owner must judge.

    Args:
        url: of the connection, checked.
        signing_key: of the connection.
        ignored: messages that came and were ignored, in words.
        blocking: somebody else was heard where nobody may be.
    """
    doubts = (
        (bool(ignored), f"somebody else sends on it; {ignored}"),
        (
            url.startswith("udpin://0.0.0.0:"),
            "it is open on every network of this machine: bind the address of one in connection.url",
        ),
        (
            not signing_key and not _is_private(url),
            "not signed (connection.signing_key): whoever is on its network can pose as either end",
        ),
    )
    doubt = "; ".join(why for stands, why in doubts if stands)
    sound = "signed" if signing_key else "this machine's own, or a cable's"
    return (Check("link", not doubt, doubt or sound, blocking=blocking),)


def _is_private(url: str) -> bool:
    """Return whether a URL is the loopback's, or a serial cable's."""
    return url.startswith("serial") or url.partition("://")[2].startswith("127.")


def mode_checks(
    mode: str, *, armable: bool, left_offboard: bool, tells_current_mode: bool
) -> tuple[Check, ...]:
    """Check the drone's mode, and how soon a pilot's mode change is noticed.

    Args:
        mode: as last reported.
        armable: whether the autopilot would arm in it.
        left_offboard: whether it stood in OFFBOARD and was put into HOLD just now.
        tells_current_mode: whether it sends CURRENT_MODE.
    """
    found = "it stood in OFFBOARD, where PX4 does not arm, and was put into HOLD" if left_offboard else mode
    stuck = mode != "HOLD" and not armable
    return (
        Check(
            "mode",
            not stuck,
            f"the autopilot does not arm in {mode or 'an unknown mode'}: switch it to Hold"
            if stuck
            else found,
        ),
        Check(
            "takeover",
            tells_current_mode,
            "a pilot's change of mode is known at once (CURRENT_MODE)"
            if tells_current_mode
            else "this autopilot reports its mode once a second (no CURRENT_MODE, which PX4 has since 1.15): "
            "a pilot's change of mode is noticed up to 1 s late",
            blocking=False,
        ),
    )


def failsafe_checks(parameters: Parameters) -> tuple[Check, ...]:
    """Check what PX4 does by itself when set-points stop: the last resort."""
    loss_s, action = parameters.COM_OF_LOSS_T, parameters.COM_OBL_RC_ACT
    named = "unknown" if action is None else LOSS_ACTIONS.get(int(action), f"unknown ({action:g})")
    sticks = int(parameters.COM_RC_OVERRIDE or 0)
    return (
        Check(
            "loss time",
            loss_s is not None and 0 < loss_s <= LONGEST_LOSS_S,
            f"set-points are lost after {_seconds(loss_s)} (COM_OF_LOSS_T, at most {LONGEST_LOSS_S:g} s)",
        ),
        Check(
            "loss action",
            action in SAFE_LOSS_ACTIONS,
            f"when they are lost: {named}"
            + ("" if action in SAFE_LOSS_ACTIONS else "; set COM_OBL_RC_ACT to 4 (land) or 5 (hold)"),
        ),
        Check(
            "pilot override",
            bool(sticks & OVERRIDE_IN_OFFBOARD),
            "the pilot's sticks end offboard"
            if sticks & OVERRIDE_IN_OFFBOARD
            else "the pilot's sticks do not end offboard, only the switch does; set COM_RC_OVERRIDE to 3",
            blocking=False,
        ),
    )


def envelope_checks(parameters: Parameters, limits: Limits) -> tuple[Check, ...]:
    """Check whether the autopilot's own limits and fence fit the commands to come."""
    checks = []
    for asked, unit, name, has in (
        (max(limits.forward_m_s, limits.backward_m_s), "m/s", "MPC_XY_VEL_MAX", parameters.MPC_XY_VEL_MAX),
        (limits.vertical_m_s, "m/s", "MPC_Z_VEL_MAX_UP", parameters.MPC_Z_VEL_MAX_UP),
        (limits.vertical_m_s, "m/s", "MPC_Z_VEL_MAX_DN", parameters.MPC_Z_VEL_MAX_DN),
        (math.degrees(limits.yaw_rate_rad_s), "deg/s", "MC_YAWRATE_MAX", parameters.MC_YAWRATE_MAX),
    ):
        if has is not None and has < asked:
            message = f"{name} is {has:g} {unit}, but limits ask for {asked:.3g}: the drone will lag behind"
            checks.append(Check("speed limits", False, message, blocking=False))
    checks = checks or [Check("speed limits", True, "the autopilot's own are wider than the profile's")]
    fence = {"GF_MAX_HOR_DIST": parameters.GF_MAX_HOR_DIST, "GF_MAX_VER_DIST": parameters.GF_MAX_VER_DIST}
    off = [name for name, value in fence.items() if not value]
    top = parameters.GF_MAX_VER_DIST
    if off:
        message = f"{' and '.join(off)} are 0 (off): set a fence that fits the field"
    elif parameters.GF_ACTION is None or int(parameters.GF_ACTION) not in STOPPING_FENCE_ACTIONS:
        action = "unknown" if parameters.GF_ACTION is None else f"{parameters.GF_ACTION:g}"
        message = f"GF_ACTION is {action}: nothing happens at the fence; set it to 2 (hold) or 5 (land)"
    elif top is not None and limits.altitude_m is not None and top < limits.altitude_m[1]:
        message = (
            f"GF_MAX_VER_DIST is {top:g} m, below the top of limits: altitude_m {limits.altitude_m[1]:g}"
        )
    else:
        message = "on"
    return (*checks, Check("geofence", message == "on", message, blocking=False))


def health_checks(
    *, unhealthy: tuple[str, ...], armable: bool, complaint: str, battery: float | None, min_battery: float
) -> tuple[Check, ...]:
    """Check the vehicle's own health report."""
    why = f"; its last warning: {complaint}" if complaint else ""
    return (
        Check(
            "sensors",
            not unhealthy,
            f"not ready: {', '.join(unhealthy)}; wait for a GPS fix, or calibrate" if unhealthy else "ready",
        ),
        Check("armable", armable, "ready to arm" if armable else f"the autopilot refuses to arm{why}"),
        Check(
            "battery",
            (battery or 0.0) >= min_battery,
            f"{_percent(battery)} left, {_percent(min_battery)} needed to take off",
        ),
    )


def _seconds(value: float | None) -> str:
    return "unknown" if value is None else f"{value:g} s"


def _percent(value: float | None) -> str:
    return "an unknown charge" if value is None else f"{value:.0%}"
