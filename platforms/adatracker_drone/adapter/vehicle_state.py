"""A PX4 vehicle's newest telemetry as a frozen snapshot, and its mode names. Pure."""

from __future__ import annotations

import enum
from dataclasses import dataclass

_MAIN_MODES = {
    1: "MANUAL",
    2: "ALTCTL",
    3: "POSCTL",
    5: "ACRO",
    6: "OFFBOARD",
    7: "STABILIZED",
    8: "RATTITUDE",
    10: "TERMINATION",
}
_AUTO = 4
_AUTO_MODES = {
    1: "READY",
    2: "TAKEOFF",
    3: "HOLD",
    4: "MISSION",
    5: "RETURN_TO_LAUNCH",
    6: "LAND",
    8: "FOLLOW_ME",
    9: "PRECLAND",
    10: "VTOL_TAKEOFF",
}
"""PX4's `px4_custom_mode.h`."""

HEALTH = {
    "is_gyrometer_calibration_ok": "gyroscope",
    "is_accelerometer_calibration_ok": "accelerometer",
    "is_magnetometer_calibration_ok": "magnetometer",
    "is_local_position_ok": "local position",
    "is_global_position_ok": "global position",
    "is_home_position_ok": "home position",
}
"""The checks that must pass before a flight, by MAVSDK's names."""


class Landed(enum.Enum):
    """The land detector's state (MAV_LANDED_STATE)."""

    UNKNOWN = 0
    ON_GROUND = 1
    IN_AIR = 2
    TAKING_OFF = 3
    """From the moment the thrust ramps up; a multicopter lifts off some 3 s later."""
    LANDING = 4


@dataclass(frozen=True, slots=True)
class VehicleState:
    """The newest telemetry; times are the run's clock at receipt, ns, 0 before the first message."""

    position_t_ns: int = 0
    position_ned_m: tuple[float, float, float] | None = None
    velocity_ned_m_s: tuple[float, float, float] | None = None
    attitude_t_ns: int = 0
    euler_frd_rad: tuple[float, float, float] | None = None
    """Roll, pitch (positive is nose up), heading (clockwise from north)."""
    yaw_rate_frd_rad_s: float = 0.0
    mode: str = ""
    """The flight mode, as the last CURRENT_MODE or HEARTBEAT gave it; see `mode_name`."""
    mode_t_ns: int = 0
    tells_current_mode: bool = False
    """CURRENT_MODE was heard: a new mode is known within 0.1 s. By HEARTBEAT alone it takes up to 1 s."""
    armed: bool = False
    armed_t_ns: int = 0
    landed: Landed = Landed.UNKNOWN
    armable: bool = False
    unhealthy: tuple[str, ...] = tuple(HEALTH.values())
    """The failing checks."""
    battery: float | None = None
    """State of charge, 0 to 1."""
    battery_t_ns: int = 0
    complaint: str = ""
    """The last text or event of severity warning or worse."""
    uid: str = ""
    """The autopilot's own number (AUTOPILOT_VERSION, uid2), in hexadecimal; empty before its first report."""

    @property
    def on_ground(self) -> bool:
        """Whether the land detector reports the ground; False also before its first report."""
        return self.landed is Landed.ON_GROUND

    @property
    def in_air(self) -> bool:
        """Whether the land detector reports any other state."""
        return self.landed not in (Landed.ON_GROUND, Landed.UNKNOWN)


def mode_name(custom_mode: int) -> str:
    """Return the name of one of PX4's modes, as MAVSDK has it; UNKNOWN for any other."""
    main, sub = custom_mode >> 16 & 0xFF, custom_mode >> 24 & 0xFF
    if main == _AUTO:
        return _AUTO_MODES.get(sub, f"EXTERNAL{sub - 10}" if 11 <= sub <= 18 else "UNKNOWN")
    return _MAIN_MODES.get(main, "UNKNOWN")
