"""Sender filter of a MAVLink link: accepts one autopilot at one address, signed if a key is set. Pure.

The first HEARTBEAT of the profile's autopilot fixes its address. From then on datagrams from elsewhere are
ignored and counted; from that address only complete frames of that autopilot pass, of the known messages.
"""

from __future__ import annotations

import enum
from typing import TYPE_CHECKING

from adatracker_deploy.core.log_throttle import worth_logging
from adatracker_drone.protocol.packets import HEARD, HEARTBEAT, Packet, split

if TYPE_CHECKING:
    from adatracker_drone.protocol.signing import Signer

Address = tuple[str, int]

AUTOPILOT_COMPONENT = 1
"""MAV_COMP_ID_AUTOPILOT1."""


class Ignored(enum.StrEnum):
    """Reasons for ignoring an incoming message."""

    STRANGER = "from an address that is not the autopilot's"
    FORGED = "without a valid signature"
    MALFORMED = "that are not MAVLink, are incomplete, or have unprintable text"
    OTHER = "of other systems or of messages that are not needed"
    """Harmless: ground stations and gimbals share a drone's link."""


_OFFENCES = (Ignored.STRANGER, Ignored.FORGED, Ignored.MALFORMED)


class Guard:
    """Filters incoming datagrams, from one thread.

    Args:
        system: the autopilot's system id.
        peer: its address where that is known beforehand, else None.
        signer: of the link; None where nothing is signed.
    """

    def __init__(self, system: int, peer: Address | None = None, signer: Signer | None = None) -> None:
        self.peer = peer
        """The accepted address; None until it is heard."""
        self.judged = 0
        """Datagrams so far."""
        self.ignored = dict.fromkeys(Ignored, 0)
        self._system = system
        self._signer = signer
        self._told = dict.fromkeys(_OFFENCES, 0)
        self._last: dict[Ignored, Address] = {}

    def admit(self, datagram: bytes, sender: Address, unix_ns: int) -> bytes:
        """Return the accepted frames of a datagram, concatenated; often none.

        Args:
            datagram: as it came.
            sender: its address.
            unix_ns: now, since 1970; for signatures.
        """
        self.judged += 1
        if self.peer is not None and sender != self.peer:
            self._ignore(Ignored.STRANGER, sender)
            return b""
        size, believed = 0, []
        for packet in split(datagram):
            size += len(packet.data)
            if why := self._fault(packet, unix_ns):
                self._ignore(why, sender)
            else:
                believed.append(packet)
        if size < len(datagram):
            self._ignore(Ignored.MALFORMED, sender)
        if self.peer is None and any(packet.message == HEARTBEAT for packet in believed):
            self.peer = sender
        return b"".join(packet.data for packet in believed) if self.peer is not None else b""

    @property
    def offences(self) -> str:
        """Describe ignored messages that should not have come; empty without any."""
        told = [f"{self.ignored[why]} {why}" for why in _OFFENCES if self.ignored[why]]
        return f"ignored: {', '.join(told)}" if told else ""

    def take_notices(self) -> tuple[str, ...]:
        """Return new notices since the last call; from one other thread."""
        notices = []
        for why in _OFFENCES:
            count = self.ignored[why]
            if worth_logging(self._told[why], count):
                host, port = self._last[why]
                notices.append(f"MAVLink: {count} ignored {why}; the last from {host}:{port}")
            self._told[why] = count
        return tuple(notices)

    def _fault(self, packet: Packet, unix_ns: int) -> Ignored | None:
        if packet.system != self._system or packet.component != AUTOPILOT_COMPONENT:
            return Ignored.OTHER
        if packet.message not in HEARD:
            return Ignored.OTHER
        if not packet.is_whole or not packet.is_plain:
            return Ignored.MALFORMED
        if self._signer is not None and not self._signer.believes(packet, unix_ns):
            return Ignored.FORGED
        return None

    def _ignore(self, why: Ignored, sender: Address) -> None:
        self._last[why] = sender
        self.ignored[why] += 1
