"""Re-runs the gate on logged commands, under the trial's own limits and under others.

The commands are as logged; only the gate's output is computed again. The link runs the gate at 50 Hz, but the
log has commands and robot states per tick only. So the slots are assumed to be evenly spaced between ticks,
and the robot's state to hold until the next. The result is close to what was sent, not equal: `agreement`
says how close, under the trial's own limits. Where the robot was engaged is not logged; a fence is laid
around its position at the first tick.
"""

from __future__ import annotations

import statistics
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

from adatracker_deploy.config.limits import Limits
from adatracker_deploy.core.messages import ZERO, PlatformState, Twist
from adatracker_deploy.core.record import BY_HAND
from adatracker_deploy.runtime.gate import GateState, Reason, Setpoint, judge
from adatracker_deploy.runtime.link import RATE_HZ

if TYPE_CHECKING:
    from collections.abc import Sequence

    from adatracker_deploy.core.record import StepRecord

SLOT_NS = round(1e9 / RATE_HZ)


@dataclass(frozen=True, slots=True)
class Judged:
    """The gate's output for one tick's command."""

    step: int
    sent: Twist
    """The velocity in the last slot before the next tick."""
    reasons: frozenset[Reason]
    """The reasons for a change, in any slot."""


@dataclass(frozen=True, slots=True)
class Judgement:
    """The gate's output for a trial's commands, up to the tick at which it stopped the robot."""

    ticks: tuple[Judged, ...]
    stop: Reason | None
    """The reason for a lasting stop, at the last of the ticks; None without one."""

    def reasons(self) -> dict[Reason, list[int]]:
        """Return the ticks at which each reason changed the command."""
        found: dict[Reason, list[int]] = {}
        for tick in self.ticks:
            for reason in sorted(tick.reasons):
                found.setdefault(reason, []).append(tick.step)
        return found


def without_gaps(steps: Sequence[StepRecord]) -> list[StepRecord]:
    """Return the ticks up to the first missing one: without commands the gate would stop."""
    end = next((place for place, (a, b) in enumerate(pairwise(steps), 1) if b.step != a.step + 1), len(steps))
    return list(steps[:end])


def judge_again(steps: Sequence[StepRecord], limits: Limits) -> Judgement:
    """Judge the commands of consecutive ticks.

    Args:
        steps: ordered, without gaps.
        limits: with their time-outs in the run's clock.
    """
    if not steps:
        return Judgement((), None)
    periods = [after.t_ns - before.t_ns for before, after in pairwise(steps)]
    ends = [
        *(step.t_ns for step in steps[1:]),
        steps[-1].t_ns + round(statistics.median(periods or [SLOT_NS])),
    ]
    state = GateState(armed_ns=steps[0].t_ns - SLOT_NS)
    ticks: list[Judged] = []
    for step, end_ns in zip(steps, ends, strict=True):
        share = step.box.covered if step.box else None
        setpoint = Setpoint(step.command, step.t_ns, share, *_limited_by(step), step.others_share)
        robot = _robot(step)
        sent = ZERO
        reasons: set[Reason] = set()
        for now_ns in range(step.t_ns, max(end_ns, step.t_ns + 1), SLOT_NS):
            state, verdict = judge(limits, state, setpoint, robot, now_ns)
            sent = verdict.twist
            reasons.update(verdict.reasons)
            if state.stop is not None:  # nothing changes that, however long the tick
                break
        ticks.append(Judged(step.step, sent, frozenset(reasons)))
        if state.stop is not None:
            return Judgement(tuple(ticks), state.stop.reason)
    return Judgement(tuple(ticks), None)


def _limited_by(step: StepRecord) -> tuple[int | None, int | None]:
    """Return what else ends a command: the age of its frame, or of the hand the dead-man button's release."""
    if step.driver != BY_HAND:
        return step.frame_t_ns, None
    return None, None if step.hand else step.t_ns


def _robot(step: StepRecord) -> PlatformState:
    """Return the robot's state as the link saw it: a tick that is logged had an engaged robot."""
    heard = step.state_age_s < float("inf")
    return PlatformState(
        t_ns=step.t_ns - round(step.state_age_s * 1e9) if heard else 0,
        mode=step.mode,
        engaged=True,
        landed=False,
        pose=step.pose,
        velocity=step.velocity,
        battery=step.battery,
    )
