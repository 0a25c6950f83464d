"""Splits, checks, packs and signs MAVLink frames. Pure.

From MAVLink's guide, "Packet Serialization" and "Message Signing". No message is decoded here.
"""

from __future__ import annotations

import binascii
import hashlib
from collections.abc import Iterator
from dataclasses import dataclass

KEY_BYTES = 32
SIGNATURE_BYTES = 13
"""Link id, 6 bytes of time, and the first 6 bytes of a SHA-256."""
TICK_NS = 10_000
"""Tick of a signature's time, which counts from the start of 2015, UTC."""
EPOCH_2015_NS = 1_420_070_400_000_000_000
HEARTBEAT, EVENT, CURRENT_MODE = 0, 410, 436
"""Message ids."""

HEARD = {
    0: 50,  # HEARTBEAT
    1: 124,  # SYS_STATUS
    4: 237,  # PING
    22: 220,  # PARAM_VALUE
    24: 24,  # GPS_RAW_INT
    30: 39,  # ATTITUDE
    31: 246,  # ATTITUDE_QUATERNION
    32: 185,  # LOCAL_POSITION_NED
    33: 104,  # GLOBAL_POSITION_INT
    49: 39,  # GPS_GLOBAL_ORIGIN
    77: 143,  # COMMAND_ACK
    111: 34,  # TIMESYNC
    141: 47,  # ALTITUDE
    147: 154,  # BATTERY_STATUS
    148: 178,  # AUTOPILOT_VERSION
    242: 104,  # HOME_POSITION
    244: 95,  # MESSAGE_INTERVAL
    245: 130,  # EXTENDED_SYS_STATE
    253: 83,  # STATUSTEXT
    331: 91,  # ODOMETRY
    EVENT: 160,
    CURRENT_MODE: 193,
}
"""The messages that this side listens to, and the CRC_EXTRA of each (common.xml)."""

_TEXTS = {22: slice(8, 24), 253: slice(1, 51)}
"""Position of the text in a message's payload: PARAM_VALUE's name, STATUSTEXT's text."""
_PLAIN = frozenset(range(0x20, 0x7F)) | {0x09}
"""Printable ASCII, and the tab that PX4 puts behind a text: nothing that a terminal would obey."""

_V1, _V2 = 0xFE, 0xFD
_V1_HEADER, _V2_HEADER = 6, 10
_CRC_BYTES = 2
_SIGNED = 1
"""MAVLINK_IFLAG_SIGNED."""
_MIRROR = bytes(int(f"{byte:08b}"[::-1], 2) for byte in range(256))


@dataclass(frozen=True, slots=True)
class Packet:
    """One frame."""

    data: bytes
    """All of it, its signature too."""
    system: int
    component: int
    message: int
    """Message id."""
    signed: bool

    @property
    def is_whole(self) -> bool:
        """Whether the checksum is right; False also where this side knows no message of that id."""
        extra = HEARD.get(self.message)
        if extra is None:
            return False
        end = len(self.data) - _CRC_BYTES - SIGNATURE_BYTES * self.signed
        return self.data[end : end + _CRC_BYTES] == _crc(self.data[1:end] + bytes([extra]))

    @property
    def is_plain(self) -> bool:
        """Whether all text in it is printable."""
        place = _TEXTS.get(self.message)
        if place is None:
            return True
        payload = self.data[_V1_HEADER if self.data[0] == _V1 else _V2_HEADER :][: self.data[1]]
        return _PLAIN.issuperset(payload[place].partition(b"\0")[0])


def split(datagram: bytes) -> Iterator[Packet]:
    """Yield the frames that lie one behind the other in a datagram, up to the first byte that begins none."""
    at = 0
    while (packet := _packet_at(datagram, at)) is not None:
        yield packet
        at += len(packet.data)


def pack(message: int, payload: bytes, extra: int, *, system: int, component: int, number: int) -> bytes:
    """Return an unsigned MAVLink 2 frame.

    Args:
        message: its id.
        payload: at most 255 bytes; trailing zeros need not be sent.
        extra: the message's CRC_EXTRA.
        system: the sender's id.
        component: the sender's, too.
        number: counts the sender's frames, modulo 256.
    """
    head = bytes((_V2, len(payload), 0, 0, number, system, component)) + message.to_bytes(3, "little")
    return head + payload + _crc(head[1:] + payload + bytes([extra]))


def signing_time(unix_ns: int) -> int:
    """Return a signature's time."""
    return max(0, unix_ns - EPOCH_2015_NS) // TICK_NS


def sign(frame: bytes, key: bytes, link: int, time: int) -> bytes:
    """Return an unsigned MAVLink 2 frame, signed.

    The checksum covers the flag that a frame is signed. What setting one bit does to a CRC depends on the
    bit's place alone, for a CRC is linear; so no message's CRC_EXTRA has to be known.

    Args:
        frame: whole, with its checksum.
        key: 32 secret bytes.
        link: tells this link from others of the same sender, 0 to 255.
        time: of `signing_time`; greater for every frame of a link.
    """
    behind = len(frame) - 3 - _CRC_BYTES + 1  # bytes that the checksum covers after the flag, CRC_EXTRA last
    flips = _crc(bytes([_SIGNED]) + bytes(behind), start=0)
    crc = bytes(a ^ b for a, b in zip(frame[-_CRC_BYTES:], flips, strict=True))
    stamped = b"".join(
        (frame[:2], bytes([frame[2] | _SIGNED]), frame[3:-_CRC_BYTES], crc, bytes([link]), _six(time))
    )
    return stamped + _digest(key, stamped)


def signature_of(packet: Packet) -> tuple[int, int]:
    """Return the link and the time that a signed packet names; nothing is verified."""
    return packet.data[-SIGNATURE_BYTES], int.from_bytes(packet.data[-12:-6], "little")


def is_signed_with(packet: Packet, key: bytes) -> bool:
    """Return whether a signed packet was made by somebody who has the key."""
    return _digest(key, packet.data[:-6]) == packet.data[-6:]


def _packet_at(datagram: bytes, at: int) -> Packet | None:
    """Return the frame that begins there; None where none does, or where it is cut short."""
    head = datagram[at : at + _V2_HEADER]
    if len(head) < _V1_HEADER + _CRC_BYTES:
        return None
    if head[0] == _V1:
        system, component, message, signed = head[3], head[4], head[5], False
        end = at + _V1_HEADER + head[1] + _CRC_BYTES
    elif head[0] == _V2 and len(head) == _V2_HEADER and head[2] in (0, _SIGNED):
        system, component, message = head[5], head[6], int.from_bytes(head[7:10], "little")
        signed = bool(head[2])
        end = at + _V2_HEADER + head[1] + _CRC_BYTES + SIGNATURE_BYTES * signed
    else:
        return None
    return Packet(datagram[at:end], system, component, message, signed) if end <= len(datagram) else None


def _six(number: int) -> bytes:
    return number.to_bytes(6, "little")


def _digest(key: bytes, data: bytes) -> bytes:
    return hashlib.sha256(key + data).digest()[:6]


def _crc(data: bytes, start: int = 0xFFFF) -> bytes:
    """Return CRC-16/MCRF4XX, little-endian: the library's CRC with every byte mirrored, before and after."""
    return binascii.crc_hqx(data.translate(_MIRROR), start).to_bytes(2, "big").translate(_MIRROR)
