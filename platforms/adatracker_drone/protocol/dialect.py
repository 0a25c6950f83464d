"""MAVLink messages of PX4 that pymavlink's common dialect lacks."""

from __future__ import annotations

import struct

from pymavlink.dialects.v20 import common as mavlink

from adatracker_drone.protocol.packets import CURRENT_MODE, EVENT, HEARD

_ARGUMENTS_BYTES = 40


class _Message(mavlink.MAVLink_message):  # type: ignore[misc]
    payload = b""

    def pack(self, mav: mavlink.MAVLink, force_mavlink1: bool = False) -> bytes:
        """Return the frame."""
        return bytes(self._pack(mav, HEARD[self.id], self.payload, force_mavlink1=force_mavlink1))


class CurrentMode(_Message):
    """The mode that flies and the one that was asked for (common.xml, CURRENT_MODE)."""

    id, msgname = CURRENT_MODE, "CURRENT_MODE"

    def __init__(self, custom_mode: int, intended_custom_mode: int) -> None:
        super().__init__(self.id, self.msgname)
        self.custom_mode = custom_mode
        self.intended_custom_mode = intended_custom_mode
        self.payload = struct.pack("<IIB", custom_mode, intended_custom_mode, 0)


class Event(_Message):
    """Something that PX4 tells by a number (common.xml, EVENT); its arguments are left empty here.

    Args:
        number: of the event.
        time_ms: since power-on.
        sequence: counts the events, modulo 2^16.
        severity: MAV_SEVERITY, both for logs and for others.
    """

    id, msgname = EVENT, "EVENT"

    def __init__(self, number: int, time_ms: int, sequence: int, severity: int) -> None:
        super().__init__(self.id, self.msgname)
        self.number = number
        head = struct.pack(
            "<IIHBBB", number, time_ms % 2**32, sequence % 2**16, 0, 0, severity << 4 | severity
        )
        self.payload = head + bytes(_ARGUMENTS_BYTES)
