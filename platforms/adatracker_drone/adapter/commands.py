"""Commands to a PX4 vehicle, as values and as MAVSDK's JSON. Pure."""

from __future__ import annotations

import json
from dataclasses import dataclass

from adatracker_drone.protocol.packets import CURRENT_MODE, HEARTBEAT

_EXTENDED_SYS_STATE, _AUTOPILOT_VERSION = 245, 148
_CUSTOM_MODE = 1
"""MAV_MODE_FLAG_CUSTOM_MODE_ENABLED."""
_PARAMETERS = 7


@dataclass(frozen=True, slots=True)
class VehicleCommand:
    """A COMMAND_LONG."""

    says: str
    """The requested action, in words that follow "did not"."""
    command: int
    """MAV_CMD."""
    parameters: tuple[float | None, ...] = ()
    """The first ones; those that are missing are 0, None is NaN: the autopilot decides."""

    def to_json(self, system: int, component: int) -> str:
        """Return its fields for one autopilot."""
        filled = (*self.parameters, *(0,) * (_PARAMETERS - len(self.parameters)))
        return json.dumps(
            {
                "target_system": system,
                "target_component": component,
                "command": self.command,
                "confirmation": 0,
                **{f"param{number}": value for number, value in enumerate(filled, 1)},
            }
        )


def _mode(says: str, main: int, sub: int) -> VehicleCommand:
    return VehicleCommand(says, 176, (_CUSTOM_MODE, main, sub))  # MAV_CMD_DO_SET_MODE, px4_custom_mode.h


def _request(says: str, message: int) -> VehicleCommand:
    return VehicleCommand(says, 512, (message,))  # MAV_CMD_REQUEST_MESSAGE


ARM, DISARM = VehicleCommand("arm", 400, (1,)), VehicleCommand("disarm", 400, (0,))
TAKE_OFF = VehicleCommand("take off", 22, (None,) * _PARAMETERS)
LAND = VehicleCommand("land", 21, (None,) * _PARAMETERS)
HOLD = _mode("hold", 4, 3)
OFFBOARD = _mode("switch to OFFBOARD", 6, 0)
TELL_MODE = _request("report its mode", HEARTBEAT)
"""PX4 answers this one at any time; CURRENT_MODE it refuses while there is nothing new in it."""
TELL_VERSION = _request("identify itself", _AUTOPILOT_VERSION)


def rates(rate_hz: float) -> tuple[VehicleCommand, ...]:
    """Return the orders to tell mode and landing at a rate. HEARTBEAT's own 1 Hz PX4 does not change."""
    return tuple(
        VehicleCommand(f"send message {message} at {rate_hz:g} Hz", 511, (message, 1e6 / rate_hz))
        for message in (CURRENT_MODE, _EXTENDED_SYS_STATE)
    )
