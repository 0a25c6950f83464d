"""Addresses, set-points and altitude hold, as pure functions.

It does no I/O and takes time as an argument. Poses are turned by `frames`, velocities here.
"""

from __future__ import annotations

import ipaddress
import json
import re
from dataclasses import astuple, dataclass, replace

from adatracker_deploy.core.errors import PlatformError, UsageError
from adatracker_deploy.core.messages import Twist
from adatracker_drone.protocol.frames import rotate

AUTOPILOT = (1, 1)
"""System and component id that PX4 answers to unless configured otherwise."""

_FRAME_BODY_NED = 8
"""MAV_FRAME_BODY_NED; PX4 rotates such a velocity by the yaw alone, so it stays level in a tilted vehicle."""
_VELOCITY_AND_YAW_RATE = 1479
"""POSITION_TARGET_TYPEMASK: ignore position (7), acceleration (448) and yaw (1024)."""
FASTEST_M_S = 100.0
"""Nothing above this is a command: it would overflow or lose its meaning in the message's float32."""

LONGEST_STEP_S = 0.2
"""After a longer silence the altitude's reference moves on as if this much time had passed, not in a jump."""

_URL_FORMS = "udpin://127.0.0.1:14540, tcpout://192.168.1.20:5760 or serial:///dev/ttyACM0:57600"
_NETWORK_URL = re.compile(r"(udpin|udpout|tcpin|tcpout)://([0-9.]+):([0-9]{1,5})")
_SERIAL_URL = re.compile(r"(serial|serial_flowcontrol):///[^:]+:[1-9][0-9]*")


def check_url(url: str) -> tuple[str, int] | None:
    """Check a connection URL's form; return the UDP address that it makes this side bind, if it does.

    MAVSDK takes numeric addresses only; a name can be accepted without a word and then nothing is heard.

    Raises:
        UsageError: the scheme is unknown, or the address, port or baud rate is missing or wrong.
    """
    if _SERIAL_URL.fullmatch(url):
        return None
    match = _NETWORK_URL.fullmatch(url)
    try:
        if match is None or not 0 < int(match[3]) < 2**16:
            raise ValueError
        address = str(ipaddress.IPv4Address(match[2]))
    except ValueError:
        raise UsageError(
            f"connection.url {url!r} is not an address that MAVSDK takes: use for example {_URL_FORMS}"
        ) from None
    return (address, int(match[3])) if match[1] == "udpin" else None


def numeric_address(text: str) -> tuple[str, int]:
    """Return the address and port that a text such as ``192.168.1.10:14580`` names.

    Raises:
        UsageError: it names none.
    """
    host, _, port = text.rpartition(":")
    try:
        if not (port.isdecimal() and 0 < int(port) < 2**16):
            raise ValueError
        return str(ipaddress.IPv4Address(host)), int(port)
    except ValueError:
        raise UsageError(
            f"connection.peer {text!r} is not an address and a port: use for example 192.168.1.10:14580"
        ) from None


def dialled(url: str) -> tuple[str, int] | None:
    """Return the UDP address that a checked URL makes this side dial, if it does."""
    match = _NETWORK_URL.fullmatch(url)
    return (match[2], int(match[3])) if match is not None and match[1] == "udpout" else None


def set_point_json(command: Twist, now_ns: int, autopilot: tuple[int, int] = AUTOPILOT) -> str:
    """Return the JSON fields of one SET_POSITION_TARGET_LOCAL_NED: a level body velocity and a yaw rate.

    Args:
        command: the velocity, forward-left-up, m/s and rad/s.
        now_ns: the sender's time, ns; wraps with the message's 32-bit milliseconds.
        autopilot: the receiver's system and component id.

    Raises:
        PlatformError: a component is NaN, infinite, or beyond `FASTEST_M_S`. PX4 would accept a NaN and leave
            the mode or stop on it.
    """
    if not all(abs(value) <= FASTEST_M_S for value in astuple(command)):
        raise PlatformError(f"refused to send {command}: not a velocity that a drone can fly")
    system, component = autopilot
    return json.dumps(
        {
            "time_boot_ms": now_ns // 1_000_000 % 2**32,
            "target_system": system,
            "target_component": component,
            "coordinate_frame": _FRAME_BODY_NED,
            "type_mask": _VELOCITY_AND_YAW_RATE,
            **dict.fromkeys(("x", "y", "z", "afx", "afy", "afz", "yaw"), 0.0),
            "vx": command.vx,
            "vy": -command.vy,
            "vz": -command.vz,
            "yaw_rate": -command.yaw_rate,
        },
        allow_nan=False,
    )


def body_velocity(
    velocity_ned_m_s: tuple[float, float, float], heading_rad: float, yaw_rate_frd_rad_s: float
) -> Twist:
    """Turn PX4's velocity (north, east, down) into the level frame in which commands are given."""
    north, east, down = velocity_ned_m_s
    forward, right = rotate(north, east, -heading_rad)
    return Twist(vx=forward, vy=-right, vz=-down, yaw_rate=-yaw_rate_frd_rad_s)


@dataclass(frozen=True, slots=True)
class AltitudeHold:
    """Keeps a drone at its height while it is flown by velocity alone.

    PX4 follows a zero climb rate by its velocity estimate, whose bias makes the drone rise or sink without
    end (measured: 2.6 m to 4.7 m in 8 s). So the commanded climb moves a reference, and the error from that
    reference is added to the climb.
    """

    low_m: float
    """The reference never goes below this altitude."""
    high_m: float
    """The reference never goes above this altitude."""
    reference_m: float
    t_ns: int
    """Time of the reference's last move."""
    gain_1_s: float = 1.0
    correction_m_s: float = 0.5
    """Largest climb rate that the error alone can cause."""

    @classmethod
    def at(cls, altitude_m: float, band_m: tuple[float, float], t_ns: int) -> AltitudeHold:
        """Start to hold the present altitude, or the nearest one inside the band."""
        low, high = band_m
        return cls(low_m=low, high_m=high, reference_m=min(max(altitude_m, low), high), t_ns=t_ns)

    def step(self, climb_m_s: float, altitude_m: float, now_ns: int) -> tuple[AltitudeHold, float]:
        """Advance to `now_ns`; return the next hold and the climb rate to command, m/s, positive up."""
        elapsed_s = min(max(now_ns - self.t_ns, 0) / 1e9, LONGEST_STEP_S)
        reference = min(max(self.reference_m + climb_m_s * elapsed_s, self.low_m), self.high_m)
        rate = (reference - self.reference_m) / elapsed_s if elapsed_s else 0.0
        correction = self.gain_1_s * (reference - altitude_m)
        correction = min(max(correction, -self.correction_m_s), self.correction_m_s)
        return replace(self, reference_m=reference, t_ns=now_ns), rate + correction
