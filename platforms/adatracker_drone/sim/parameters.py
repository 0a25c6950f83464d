"""PX4's parameters that matter here: table, values and MAVLink encoding.

Types, defaults and ranges are from the parameter reference of PX4 v1.16.
"""

from __future__ import annotations

import enum
import math
import struct
from collections.abc import Mapping
from dataclasses import dataclass

from adatracker_deploy.core.errors import UsageError


class Kind(enum.IntEnum):
    """MAV_PARAM_TYPE of the two types that PX4 has."""

    INT32 = 6
    REAL32 = 9


@dataclass(frozen=True, slots=True)
class Parameter:
    """One parameter's type, value after a reset, and inclusive range."""

    kind: Kind
    default: float
    low: float
    high: float

    def accepts(self, value: float) -> bool:
        """Return whether the value is finite, of the type and in range."""
        whole = self.kind is Kind.REAL32 or (math.isfinite(value) and float(value).is_integer())
        return whole and self.low <= value <= self.high


def _real(default: float, low: float, high: float) -> Parameter:
    return Parameter(Kind.REAL32, default, low, high)


def _int(default: int, low: int, high: int) -> Parameter:
    return Parameter(Kind.INT32, default, low, high)


PARAMETERS: dict[str, Parameter] = {
    "COM_DISARM_LAND": _real(2.0, -1, 20),
    "COM_DISARM_PRFLT": _real(10.0, -1, 30),
    "COM_OBL_RC_ACT": _int(0, 0, 7),
    "COM_OF_LOSS_T": _real(1.0, 0, 60),
    "COM_RC_IN_MODE": _int(3, 0, 4),
    "COM_RC_OVERRIDE": _int(1, 0, 3),
    "COM_SPOOLUP_TIME": _real(1.0, 0, 30),
    "GF_ACTION": _int(2, 0, 5),
    "GF_MAX_HOR_DIST": _real(0.0, 0, 10000),
    "GF_MAX_VER_DIST": _real(0.0, 0, 10000),
    "MC_YAWRATE_MAX": _real(200.0, 0, 1800),
    "MIS_TAKEOFF_ALT": _real(2.5, 0, 80),
    "MPC_LAND_SPEED": _real(0.7, 0.6, 10),
    "MPC_TKO_RAMP_T": _real(3.0, 0, 5),
    "MPC_TKO_SPEED": _real(1.5, 1, 5),
    "MPC_XY_CRUISE": _real(5.0, 3, 20),
    "MPC_XY_VEL_MAX": _real(12.0, 0, 20),
    "MPC_Z_VEL_MAX_DN": _real(1.5, 0.5, 4),
    "MPC_Z_VEL_MAX_UP": _real(3.0, 0.5, 8),
    "NAV_MC_ALT_RAD": _real(0.8, 0.05, 200),
    "RTL_MIN_DIST": _real(10.0, 0.5, 100),
    "RTL_RETURN_ALT": _real(60.0, 0, 10000),
    "SYS_AUTOSTART": _int(4011, 0, 9999999),  # DJI F450
}


def to_wire(kind: Kind, value: float) -> float:
    """Return the float that carries a parameter byte-wise: an integer's four bytes read as a float."""
    if kind is Kind.REAL32:
        return value
    (carried,) = struct.unpack("<f", struct.pack("<i", int(value)))
    return float(carried)


def from_wire(kind: Kind, carried: float) -> float:
    """Return the value that `to_wire` made into `carried`."""
    if kind is Kind.REAL32:
        return carried
    (value,) = struct.unpack("<i", struct.pack("<f", carried))
    return float(value)


class Parameters:
    """The values of one vehicle."""

    def __init__(self, changed: Mapping[str, float]) -> None:
        """Start from the defaults with some changed.

        Raises:
            UsageError: a changed name is unknown or its value is not accepted.
        """
        self._values = {name: entry.default for name, entry in PARAMETERS.items()}
        for name, value in changed.items():
            if not self.set(name, value):
                known = PARAMETERS.get(name)
                why = f"not in [{known.low:g}, {known.high:g}]" if known else "no such parameter here"
                raise UsageError(f"sitl.parameters: {name} = {value:g}: {why}")

    def __getitem__(self, name: str) -> float:
        return self._values[name]

    def set(self, name: str, value: float) -> bool:
        """Change a value; return False, and change nothing, where PX4 or its ground stations would refuse."""
        entry = PARAMETERS.get(name)
        if entry is None or not entry.accepts(value):
            return False
        self._values[name] = value
        return True
