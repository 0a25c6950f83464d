"""The messages of the rover's wire. Pure: values to bytes and back.

Little-endian whole numbers, so that no NaN can be said; axes are those of ROS REP 103.

    host to rover, 8 bytes:   "RQ", what is asked, 0, forward mm/s, yaw rate mrad/s
    rover to host, 20 bytes:  "RP", mode, battery %, its own command time-out ms, x mm, y mm, heading mrad,
                              forward mm/s, yaw rate mrad/s

UDP may lose, double or swap datagrams. None of that moves a rover that was stopped: it follows DRIVE only
while enabled, and a late ENABLE finds it at rest, where its time-out keeps it.
"""

from __future__ import annotations

import enum
import struct
from dataclasses import dataclass

from adatracker_deploy import ZERO, Pose, Twist

_REQUEST = struct.Struct("<2sBxhh")
_REPORT = struct.Struct("<2sBBHiihhh")
_STILL = 0.05
"""m/s and rad/s: slower is standing."""


class Ask(enum.IntEnum):
    """The host's requests; each is answered with reports from then on."""

    REPORT = 0
    ENABLE = 1
    DRIVE = 2
    STOP = 3
    """Brake, and take no DRIVE until the next ENABLE."""


class Mode(enum.IntEnum):
    """The controller that the rover obeys."""

    IDLE = 0
    DRIVE = 1
    """The host."""
    TIMED_OUT = 2
    """Nobody: it was enabled and heard no DRIVE for too long."""
    REMOTE = 3
    """A person with the remote control, until they let go; the host is ignored."""


@dataclass(frozen=True, slots=True)
class Request:
    """Host to rover."""

    ask: Ask
    velocity: Twist = ZERO
    """For DRIVE; its forward and yaw parts count."""


@dataclass(frozen=True, slots=True)
class Report:
    """Rover to host, 50 times a second."""

    mode: Mode
    battery: float
    """State of charge, 0 to 1."""
    timeout_s: float
    """Without DRIVE for so long it stops by itself; 0 if that is switched off."""
    pose: Pose
    """From where it was switched on: x forward, y left."""
    velocity: Twist

    @property
    def braked(self) -> bool:
        """It follows no command of the host's."""
        return self.mode is not Mode.DRIVE

    @property
    def at_rest(self) -> bool:
        """It is braked and stands."""
        return self.braked and max(abs(self.velocity.vx), abs(self.velocity.yaw_rate)) < _STILL


def quantise(velocity: Twist) -> Twist:
    """Return what the wire can say of a finite velocity: forward and yaw, in thousandths, within 16 bits."""
    return Twist(vx=_thousandths(velocity.vx) / 1000, yaw_rate=_thousandths(velocity.yaw_rate) / 1000)


def encode_request(request: Request) -> bytes:
    """Return the datagram; the velocity must be finite."""
    velocity = request.velocity
    return _REQUEST.pack(b"RQ", request.ask, _thousandths(velocity.vx), _thousandths(velocity.yaw_rate))


def decode_request(data: bytes) -> Request | None:
    """Return the request in a datagram, or None where there is none."""
    try:
        magic, ask, vx, yaw_rate = _REQUEST.unpack(data)
        return Request(Ask(ask), Twist(vx=vx / 1000, yaw_rate=yaw_rate / 1000)) if magic == b"RQ" else None
    except (struct.error, ValueError):
        return None


def encode_report(report: Report) -> bytes:
    """Return the datagram."""
    pose, velocity = report.pose, report.velocity
    return _REPORT.pack(
        *(b"RP", report.mode, round(report.battery * 100), round(report.timeout_s * 1000)),
        *(round(pose.x * 1000), round(pose.y * 1000), round(pose.yaw * 1000)),
        *(_thousandths(velocity.vx), _thousandths(velocity.yaw_rate)),
    )


def decode_report(data: bytes) -> Report | None:
    """Return the report in a datagram, or None where there is none."""
    try:
        magic, mode, percent, timeout_ms, x, y, yaw, vx, yaw_rate = _REPORT.unpack(data)
        if magic != b"RP" or percent > 100:
            return None
        return Report(
            mode=Mode(mode),
            battery=percent / 100,
            timeout_s=timeout_ms / 1000,
            pose=Pose(x=x / 1000, y=y / 1000, yaw=yaw / 1000),
            velocity=Twist(vx=vx / 1000, yaw_rate=yaw_rate / 1000),
        )
    except (struct.error, ValueError):
        return None


def _thousandths(value: float) -> int:
    return round(max(-32.767, min(32.767, value)) * 1000)
