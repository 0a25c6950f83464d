"""Decodes PX4's events (EVENT, message 410): why arming or a mode was refused. Pure.

To a companion computer PX4 sends numbers, and texts (STATUSTEXT) to ground stations alone. A number is made
from the event's name in PX4's source (`events.h`): the lower 24 bits of its FNV-1a hash, and 1 above them for
the autopilot. Names and messages are those of PX4's Commander and its HealthAndArmingChecks.
"""

from __future__ import annotations

_FNV_BASIS, _FNV_PRIME = 0x811C9DC5, 0x01000193
_AUTOPILOT = 1 << 24
WARNING = 4
"""MAV_SEVERITY; greater numbers are notices and less."""

NO_REASON = "commander_arm_denied_resolve_failures"
"""PX4 says this after what it found; it says nothing more."""
REASONS = {
    "commander_arm_denied_calibrating": "Arming denied: calibrating",
    "commander_arm_denied_not_manual": "Arming denied: switch to manual mode first",
    "commander_arm_denied_resolve_failures": "Arming denied: resolve system health failures first",
    "commander_arm_denied_throttle_center": "Arming denied: throttle above center",
    "commander_arm_denied_throttle_high": "Arming denied: high throttle",
    "commander_disarm_denied_not_landed": "Disarming denied: not landed",
    "commander_failsafe_enter_generic": "Failsafe activated",
    "commander_failsafe_enter_generic_hold": "Failsafe activated: holding first",
    "commander_modeswitch_not_avail": "the mode that was asked for is not possible now",
    "commander_unsupported_auto_mode": "unsupported auto mode",
    "check_battery_disconnected": "a battery is disconnected",
    "check_battery_missing": "a battery is missing",
    "check_modes_angular_velocity": "angular velocity not valid",
    "check_modes_attitude": "no valid attitude estimate",
    "check_modes_cannot_takeoff": "mode not suitable for arming: switch to another mode first",
    "check_modes_global_pos": "no valid global position estimate",
    "check_modes_home_position": "home position not set",
    "check_modes_local_alt": "no valid altitude estimate",
    "check_modes_local_pos": "no valid position estimate",
    "check_modes_manual_control": "no manual control input",
    "check_modes_not_supported": "mode not supported",
    "check_modes_offboard_signal": "no offboard signal",
    "check_rc_dl_no_dllink": "no connection to the ground control station",
    "check_system_arm_auth_failed": "arm authorization denied",
    "check_system_avoidance_not_ready": "avoidance system not ready",
    "check_system_flight_term_active": "flight termination active",
    "check_system_no_global_pos": "global position required",
    "check_system_no_home_pos": "home position required",
    "check_system_safety_button": "press the safety button first",
    "check_system_usb_connected": "USB connected",
}
"""PX4's text of each event, by its name."""


def number_of(name: str) -> int:
    """Return the number of an event of PX4's autopilot."""
    value = _FNV_BASIS
    for byte in name.encode():
        value = (value ^ byte) * _FNV_PRIME & 0xFFFFFFFF
    return value & 0xFFFFFF | _AUTOPILOT


_BY_NUMBER = {number_of(name): reason for name, reason in REASONS.items()}


def reason_of(number: int) -> str:
    """Return what an event says, in words; of one that is not known here, its number."""
    return _BY_NUMBER.get(number, f"PX4 event {number:#x}")
