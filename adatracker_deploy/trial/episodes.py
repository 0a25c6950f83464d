"""Cuts a trial into episodes to learn from: what was seen, what the robot was sent, what came of it.

An episode is a run of consecutive slots of the loop, each with its frame. A slot that was missed, a tick that
was stale or is not in the log, a frame that is not in the log: each ends it, and the next one begins behind.
So within an episode time goes on at the policy's rate, and nothing in it is made up.
"""

from __future__ import annotations

import statistics
from collections.abc import Container, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

from adatracker_deploy.core.messages import ZERO, Box, Twist
from adatracker_deploy.core.record import Outcome, StepRecord
from adatracker_deploy.core.task import box_reward, is_box

TERMINAL: tuple[Outcome, ...] = ("lost", "wrong_person", "collision")
"""Outcomes by which the task itself ended; a horizon or a stop only ends the log."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Transition:
    """One tick, what was sent for it, and what the next tick measured."""

    tick: StepRecord
    sent: Twist
    """The velocity that the link made of the command; where a newer command replaced it before the link's
    slot, the one that it went on sending."""
    reward: float
    """R of the next tick's box against the trial's first (`box_reward`), 0 without one; in [0, 1]."""
    seen: bool
    """The next tick had a box."""
    after: StepRecord
    """The next tick."""
    done: bool
    """The trial ended there, by an outcome in `TERMINAL`."""


Episode = tuple[Transition, ...]
"""At least one."""


def episodes(steps: Sequence[StepRecord], outcome: Outcome, frames: Container[int]) -> list[Episode]:
    """Cut a trial's ticks into episodes.

    Args:
        steps: ordered, up to where the trial ended (`ending`).
        outcome: how it ended.
        frames: numbers of the frames that the log has.
    """
    reference = first_box(steps)
    found: list[list[Transition]] = [[]]
    for place, (sent, (step, after)) in enumerate(zip(_sent(steps), pairwise(steps), strict=False)):
        if not _joined(step, after) or step.frame_seq not in frames:
            found.append([])
            continue
        box, last = seen_box(after), place + 2 == len(steps)
        found[-1].append(
            Transition(
                tick=step,
                sent=sent,
                reward=box_reward(box, reference) if box is not None and reference is not None else 0.0,
                seen=box is not None,
                after=after,
                done=last and outcome in TERMINAL,
            )
        )
    return [tuple(run) for run in found if run]


def seen_box(step: StepRecord) -> Box | None:
    """Return a tick's box; None where the target is lost, and of a box that is none."""
    return step.box if step.box is not None and is_box(step.box) else None


def first_box(steps: Sequence[StepRecord]) -> Box | None:
    """Return a trial's first box, by which it is scored."""
    return next((box for box in map(seen_box, steps) if box is not None), None)


def tick_rate_hz(steps: Sequence[StepRecord]) -> float | None:
    """Return the rate of a trial's ticks by its median period; None of a single one."""
    periods = [(after.t_ns - before.t_ns) / (after.step - before.step) for before, after in pairwise(steps)]
    median_ns = statistics.median(periods) if periods else 0
    return 1e9 / median_ns if median_ns > 0 else None


def _joined(step: StepRecord, after: StepRecord) -> bool:
    """Return whether two ticks are measurements of neighbouring slots."""
    return (
        after.step == step.step + 1
        and after.missed_deadlines == step.missed_deadlines
        and not step.stale
        and not after.stale
    )


def _sent(steps: Sequence[StepRecord]) -> Iterator[Twist]:
    """Give what the robot was made to do during each tick."""
    last = ZERO
    for step in steps:
        last = step.sent or last
        yield last
