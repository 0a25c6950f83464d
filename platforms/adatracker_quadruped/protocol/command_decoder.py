"""Command decoder: a malformed, stale or repeated command moves nothing. Pure."""

from __future__ import annotations

from typing import TYPE_CHECKING

from adatracker_deploy.core.messages import ZERO, Twist
from adatracker_quadruped.protocol import sport
from adatracker_quadruped.protocol.keys import Keys, parse_attachment
from adatracker_quadruped.protocol.messages import Malformed, decode_twist, decode_twist_stamped

if TYPE_CHECKING:
    from adatracker_quadruped.protocol.connection import Connection

STALE_S = 0.3
"""An older command is dropped."""
_MOST_SENDERS = 64
"""Cap on senders: invented ones must not fill the memory."""


class CommandDecoder:
    """Decodes commands of the connection's message type; counts those it rejects."""

    def __init__(self, connection: Connection) -> None:
        self._command = connection.command
        self._attached = Keys(connection).attaches
        self._sequences: dict[bytes, int] = {}
        self.dropped = 0

    def take(self, payload: bytes, attachment: bytes | None, unix_ns: int) -> Twist | None:
        """Return the velocity that a message asks for; None for one that is malformed, stale or out of order.

        Args:
            payload: of the command's topic.
            attachment: what came with it.
            unix_ns: when it is received, since 1970. Only a TwistStamped is dated, by its sender's clock,
                which on a network must agree with the robot's; the simulated one shares it.
        """
        try:
            if self._attached:
                self._check_order(attachment)
            twist, stamp_ns = self._decode(payload)
            if stamp_ns is not None and unix_ns - stamp_ns > STALE_S * 1e9:
                raise Malformed(f"a command that is {(unix_ns - stamp_ns) / 1e9:.2f} s old")
        except Malformed:
            self.dropped += 1
            return None
        return twist

    def _decode(self, payload: bytes) -> tuple[Twist, int | None]:
        match self._command:
            case "twist":
                return decode_twist(payload), None
            case "twist_stamped":
                stamped = decode_twist_stamped(payload)
                return stamped.twist, stamped.stamp_ns
            case "unitree_sport":
                request = sport.decode_request(payload)
                if request.api_id == sport.STOP_MOVE:
                    return ZERO, None
                if request.twist is None:
                    raise Malformed(f"no such request here: {request.api_id}")
                return request.twist, None

    def _check_order(self, attachment: bytes | None) -> None:
        sequence, _, sender = parse_attachment(attachment or b"")
        if sequence <= self._sequences.get(sender, 0):
            raise Malformed(f"sequence number {sequence} came before")
        if len(self._sequences) >= _MOST_SENDERS:
            self._sequences.clear()
        self._sequences[sender] = sequence
