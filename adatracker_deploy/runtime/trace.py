"""Ticks that wait for what the link makes of them, so that one record is one tick's. No I/O, no clock.

A tick is over before the link has acted on its set-point. Its record waits until the link says what became of
that set-point, which the set-point's own time names; then it is whole.
"""

from __future__ import annotations

from collections import deque
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

from adatracker_deploy.runtime.link import Phase

if TYPE_CHECKING:
    from adatracker_deploy.core.messages import Seen
    from adatracker_deploy.core.record import Latency, StepRecord
    from adatracker_deploy.runtime.link import Acted, LinkStatus

PATIENCE_TICKS = 2
"""A record waits no longer: at 50 Hz, the link's own rate, its answer may miss one tick, and a link that does
not run answers none."""


class Handed(NamedTuple):
    """A tick whose set-point is in the link's hands."""

    record: StepRecord
    """As it is known before the link has acted; its `t_ns` names the set-point."""
    seen: Seen
    handed_ns: int
    """When the link could read the set-point."""


class Trace:
    """The ticks that wait, the oldest first."""

    def __init__(self) -> None:
        self._waiting: deque[Handed] = deque()

    def hand_over(self, record: StepRecord, seen: Seen, handed_ns: int) -> None:
        """Take a tick whose set-point the link can read from `handed_ns` on."""
        self._waiting.append(Handed(record, seen, handed_ns))

    def settled(self, status: LinkStatus | None, patience: int = PATIENCE_TICKS) -> list[Handed]:
        """Return, in order, the ticks that need not wait any more, with what the link made of each.

        Args:
            status: what the link did last; None where it says nothing.
            patience: how many ticks may go on waiting; 0 ends all waiting.
        """
        done: list[Handed] = []
        acted = status.acted if status else None
        while self._waiting:
            first = self._waiting[0]
            answered = acted is not None and first.record.t_ns <= acted.setpoint_ns
            stopped = status is not None and status.phase is not Phase.ACTIVE
            if not (answered or stopped or len(self._waiting) > patience):
                break
            self._waiting.popleft()
            done.append(first._replace(record=_answered(first, status)))
        return done


def _answered(tick: Handed, status: LinkStatus | None) -> StepRecord:
    """Return a tick's record with what the link last sent for it, and why; as it is where that is not known.

    A set-point that a newer one replaced before the link's slot was never sent. One that a stop forestalled
    was answered by the stop.
    """
    record, acted = tick.record, status.acted if status else None
    if status is None:
        return record
    if acted is not None and acted.setpoint_ns == record.t_ns:
        latency = _to_the_wire(record.latency, tick, acted)
        return replace(record, sent=status.sent, gate=status.reasons, latency=latency)
    if status.phase is not Phase.ACTIVE and (acted is None or acted.setpoint_ns < record.t_ns):
        return replace(record, sent=status.sent, gate=status.reasons)
    return record


def _to_the_wire(latency: Latency, tick: Handed, acted: Acted) -> Latency:
    return replace(
        latency,
        gate_ms=(acted.judged_ns - tick.handed_ns) / 1e6,
        send_ms=(acted.sent_ns - acted.judged_ns) / 1e6,
        sensor_to_wire_ms=(acted.sent_ns - tick.seen.frame.t_ns) / 1e6,
    )
