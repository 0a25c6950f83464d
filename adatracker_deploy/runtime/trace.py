"""Joins each tick with the link's answer to its set-point, so that a record is of one tick. No I/O, no clock.

A tick ends before the link has acted on its set-point. Its record waits until the link reports what became of
that set-point, identified by the set-point's own time; then it is complete.
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
"""A record waits no longer, ticks: at 50 Hz, the link's own rate, its answer may miss one tick, and a dead
link never answers."""


class Handed(NamedTuple):
    """A tick whose set-point was handed to the link."""

    record: StepRecord
    """The record before the link has acted; its `t_ns` identifies the set-point."""
    seen: Seen
    handed_ns: int
    """Time at which it was handed over."""


class Trace:
    """The pending ticks, oldest first."""

    def __init__(self) -> None:
        self._waiting: deque[Handed] = deque()

    def hand_over(self, record: StepRecord, seen: Seen, handed_ns: int) -> None:
        """Add a tick whose set-point was handed over at `handed_ns`."""
        self._waiting.append(Handed(record, seen, handed_ns))

    def settled(self, status: LinkStatus | None, patience: int = PATIENCE_TICKS) -> list[Handed]:
        """Return, in order, the ticks that need not wait any longer, each with the link's answer.

        Args:
            status: the link's newest status; None without one.
            patience: how many ticks may keep waiting; 0 ends all waiting.
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
    """Return a tick's record with what the link last sent for it, and why; unchanged if unknown.

    A set-point replaced by a newer one before the link's slot was never sent. One preempted by a stop was
    answered by the stop.
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
