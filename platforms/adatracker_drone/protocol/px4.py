"""PX4's flight modes and command results.

From PX4 v1.16 (`px4_custom_mode.h`, Commander) and MAVLink's common.xml.
"""

from __future__ import annotations

import enum


class Mode(enum.Enum):
    """A flight mode: PX4's custom main mode and sub mode."""

    MANUAL = (1, 0)
    ALTCTL = (2, 0)
    POSCTL = (3, 0)
    TAKEOFF = (4, 2)
    HOLD = (4, 3)
    RTL = (4, 5)
    LAND = (4, 6)
    OFFBOARD = (6, 0)
    STABILIZED = (7, 0)

    @property
    def custom_mode(self) -> int:
        """The number in HEARTBEAT: main mode in bits 16 to 23, sub mode in bits 24 to 31."""
        main, sub = self.value
        return (main << 16) | (sub << 24)

    @classmethod
    def find(cls, main: int, sub: int) -> Mode | None:
        """Return the mode with these numbers, or None; only automatic modes have a sub mode."""
        wanted = (main, sub if main == cls.HOLD.value[0] else 0)
        return next((mode for mode in cls if mode.value == wanted), None)

    @property
    def is_auto(self) -> bool:
        """Return whether the autopilot navigates by itself."""
        return self in (Mode.TAKEOFF, Mode.HOLD, Mode.RTL, Mode.LAND)


class Result(enum.IntEnum):
    """MAV_RESULT."""

    ACCEPTED = 0
    REFUSED_NOW = 1
    """TEMPORARILY_REJECTED: what PX4 answers when an arming check or a mode's requirement fails."""
    DENIED = 2
    UNSUPPORTED = 3
    FAILED = 4


class Landed(enum.IntEnum):
    """MAV_LANDED_STATE."""

    ON_GROUND = 1
    IN_AIR = 2
    TAKING_OFF = 3
    LANDING = 4


class Severity(enum.IntEnum):
    """MAV_SEVERITY of the texts that a ground station shows."""

    CRITICAL = 2
    WARNING = 4
    INFO = 6


LOSS_ACTIONS = {
    0: Mode.POSCTL,
    1: Mode.ALTCTL,
    2: Mode.STABILIZED,
    3: Mode.RTL,
    4: Mode.LAND,
    5: Mode.HOLD,
    6: None,
    7: None,
}
"""COM_OBL_RC_ACT (PX4 v1.16); None stops the motors: 6 terminates the flight, 7 disarms."""
NEEDS_STICKS = frozenset({Mode.MANUAL, Mode.ALTCTL, Mode.POSCTL, Mode.STABILIZED})
"""Nobody holds any here: armed it enters none but POSCTL, in which it then stays where it is."""
TRANSIENT = frozenset({Mode.TAKEOFF, Mode.LAND, Mode.RTL})
"""They end with the flight: disarmed, the vehicle is in the mode that was asked for before them."""
