"""Follows each set-point to the wire: of which frame it was made, and what the link says became of it. Pure.

A tick is over before the link has acted on its command, so what came of it is known a tick later.
"""

from __future__ import annotations

from collections import deque
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from adatracker_deploy.runtime.link import Acted

_REMEMBERED = 100
"""Set-points: a link that has acted on none of them for so long will not."""


class Arrival(NamedTuple):
    """One set-point's way from the loop to the robot, ms of the run's clock."""

    gate_ms: float
    """From being handed over until the gate had judged it."""
    send_ms: float
    """What the adapter took to send it."""
    sensor_to_wire_ms: float
    """From its frame's capture until it was sent."""


class _HandedOver(NamedTuple):
    setpoint_ns: int
    frame_ns: int
    handed_ns: int


class Trace:
    """The set-points that are on their way."""

    def __init__(self) -> None:
        self._on_the_way: deque[_HandedOver] = deque(maxlen=_REMEMBERED)

    def hand_over(self, setpoint_ns: int, frame_ns: int, handed_ns: int) -> None:
        """Note a set-point, named by its time, with its frame's capture and when the link could read it."""
        self._on_the_way.append(_HandedOver(setpoint_ns, frame_ns, handed_ns))

    def arrived(self, acted: Acted | None) -> Arrival | None:
        """Say how the set-point that the link acted on fared; None when it is none of ours, or was told.

        Those handed over before it never will arrive: the link takes the newest only.
        """
        if acted is None:
            return None
        while self._on_the_way and self._on_the_way[0].setpoint_ns <= acted.setpoint_ns:
            one = self._on_the_way.popleft()
            if one.setpoint_ns == acted.setpoint_ns:
                return Arrival(
                    gate_ms=(acted.judged_ns - one.handed_ns) / 1e6,
                    send_ms=(acted.sent_ns - acted.judged_ns) / 1e6,
                    sensor_to_wire_ms=(acted.sent_ns - one.frame_ns) / 1e6,
                )
        return None
