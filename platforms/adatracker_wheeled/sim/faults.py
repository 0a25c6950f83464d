"""Faults of the simulated base: as frames on its bus, and by the names that ``--fault`` takes.

The frames use the 29-bit id 0x1ADAFA17, which no base that this package knows does: AgileX's and ODrive's
ids have 11 bits. The adapter never sends it. By hand, on the simulation's bus: ``cansend vcan0
1ADAFA17#0101`` begins a takeover by remote control, ``1ADAFA17#0100`` ends it.
"""

from __future__ import annotations

from typing import get_args

from adatracker_deploy.core.faults import (
    BATTERY_LOW,
    CAMERA_FREEZE,
    CAMERA_GONE,
    LINK_DROP,
    ROBOT_SILENT,
    TAKEOVER,
    Fault,
)
from adatracker_wheeled.protocol.frames import CanFrame
from adatracker_wheeled.sim.settings import FaultName

INJECTION_ID = 0x1ADAFA17

FAULTS: dict[FaultName, int] = {
    "remote": 1,  # somebody drives with the remote control
    "emergency_stop": 2,  # the button is pressed
    "fault": 3,  # the base reports its first named error
    "silence": 4,  # nothing is sent any more; what is received still counts
    "frozen_feedback": 5,  # measured motion and odometry are not sent any more
    "frozen_state": 6,  # the same state, counter and all, is sent again and again
    "low_battery": 7,  # 5 % left
}
"""The first data byte of each; the second is 1 to begin and 0 to end it."""
assert set(FAULTS) == set(get_args(FaultName))

FAULT_NAMES: dict[str, FaultName] = {
    ROBOT_SILENT.name: "silence",
    BATTERY_LOW.name: "low_battery",
    "remote_control": "remote",
    TAKEOVER.name: "remote",
    "emergency_stop": "emergency_stop",
    "base_fault": "fault",
    "frozen_feedback": "frozen_feedback",
    "frozen_state": "frozen_state",
}
"""The base's own fault for each fault of a rehearsal."""
FOREIGN_COMMANDS = Fault("foreign_commands", "another host on the bus sends it commands", 2.0)
ON_DEMAND = (
    *(CAMERA_FREEZE, CAMERA_GONE, LINK_DROP, ROBOT_SILENT, BATTERY_LOW, TAKEOVER),
    Fault("remote_control", "somebody drives with the remote control", 2.0),
    Fault("emergency_stop", "the emergency stop is pressed, and let go", 2.0),
    Fault("base_fault", "the base reports an error", 2.0),
    Fault("frozen_feedback", "the measured motion is no longer sent", 2.0),
    FOREIGN_COMMANDS,
    Fault("frozen_state", "the same state is sent again and again", 2.0),
)
"""All that a rehearsal may ask for; the camera and the bus are `sitl`'s."""


def injection(fault: FaultName, *, begin: bool) -> CanFrame:
    """Return the frame that begins or ends a fault."""
    return CanFrame(INJECTION_ID, bytes([FAULTS[fault], begin]), extended=True)


def parse_injection(frame: CanFrame) -> tuple[FaultName, bool] | None:
    """Return the fault and whether it begins; None for any other frame."""
    if frame.id != INJECTION_ID or not frame.extended or len(frame.data) != 2:
        return None
    number, begin = frame.data
    return next(((name, begin == 1) for name, known in FAULTS.items() if known == number), None)
