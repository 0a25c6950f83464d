"""Converts steps of log format 1 to format 2: the link's answer moves to the tick whose command it answered.

In format 1 a record was written before the link had acted on its command: `sent`, `gate` and the latencies
behind the gate are of the tick before, and what became of the last command is not in the log.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, TypeVar

from adatracker_deploy.core.record import ScoredStep, StepRecord

if TYPE_CHECKING:
    from collections.abc import Sequence

StepT = TypeVar("StepT", StepRecord, ScoredStep)


def as_of_format_2(steps: Sequence[StepT]) -> list[StepT]:
    """Return steps of format 1, ordered by step, with what each was answered; nothing before a gap."""
    followers = {step.step - 1: step for step in steps}
    return [_with_answer(step, followers.get(step.step)) for step in steps]


def _with_answer(step: StepT, after: StepT | None) -> StepT:
    late = after.latency if after else None
    latency = replace(
        step.latency,
        gate_ms=late.gate_ms if late else None,
        send_ms=late.send_ms if late else None,
        sensor_to_wire_ms=late.sensor_to_wire_ms if late else None,
    )
    stale = step.latency.infer_ms == 0  # as that format said it: the policy was not asked
    if isinstance(step, StepRecord):
        sent, gate = (after.sent, after.gate) if isinstance(after, StepRecord) else (None, ())
        return replace(step, sent=sent, gate=gate, stale=stale or not step.action, latency=latency)
    return replace(step, stale=stale, latency=latency)
