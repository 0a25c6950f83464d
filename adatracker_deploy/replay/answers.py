"""Re-runs a policy on logged inputs: the same observations in the same order, from the same reset.

A policy is a function of its bundle, its reset seed and its observations; its state, including its last
action, follows from these. The log holds each exactly: masks without loss, numbers as text that parses to the
same bits. So the same bundle on the same machine gives bit-identical answers. It is an open loop: another
policy sees the consequences of the logged actions, not of its own.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from adatracker_deploy.core.messages import Observation, TargetState

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from numpy.typing import NDArray

    from adatracker_deploy.core.messages import ClassMask
    from adatracker_deploy.core.record import StepRecord
    from adatracker_deploy.policy.base import Policy
    from adatracker_deploy.trial.reader import LoggedMask

Numbers = tuple[float, ...]
"""float32 values, each held exactly."""
_STATES = {state.value: state for state in TargetState}


@dataclass(frozen=True, slots=True)
class Answer:
    """A policy's answer to one tick: its action and its context z, empty without an encoder."""

    step: StepRecord
    action: Numbers
    context: Numbers


@dataclass(frozen=True, slots=True)
class Gap:
    """A gap in the logged observations; the policy's state is unknown from there on."""

    step: int
    why: str


@dataclass(frozen=True, slots=True)
class Replayed:
    """A policy's answers, up to the end of the log or its first gap."""

    answers: tuple[Answer, ...]
    idle: int
    """Ticks so far whose observation was too old, so that the policy was not run."""
    gap: Gap | None


def answer_again(
    steps: Iterable[StepRecord], masks: Iterator[LoggedMask], policy: Policy, seed: int
) -> Replayed:
    """Reset a policy and run it on the logged inputs, tick by tick.

    Args:
        steps: of one trial, ordered; a trial begins with step 0.
        masks: of the same trial, ordered by frame.
        policy: asked in order; a tick without an action was not acted on, and is not asked.
        seed: that the trial's reset was given.
    """
    policy.reset(seed)
    answers: list[Answer] = []
    idle = 0
    newest: LoggedMask | None = None
    for due, step in enumerate(steps):
        if step.step != due:
            return Replayed(tuple(answers), idle, Gap(due, "the log lacks this tick"))
        if not step.action:
            idle += 1
            continue
        while newest is None or newest.seq < step.frame_seq:
            newest = next(masks, None)
            if newest is None:
                break
        if newest is None or newest.seq != step.frame_seq:
            return Replayed(tuple(answers), idle, Gap(due, "the log lacks the mask of this tick's frame"))
        action = policy.act(_observation(step, newest.mask))
        context = () if action.context is None else _numbers(action.context)
        answers.append(Answer(step, _numbers(action.values), context))
    return Replayed(tuple(answers), idle, None)


def _observation(step: StepRecord, mask: ClassMask) -> Observation:
    return Observation(
        mask=mask,
        box=step.box,
        confidence=step.confidence,
        t_ns=step.frame_t_ns,
        seq=step.frame_seq,
        target=_STATES.get(step.target or ""),
    )


def _numbers(values: NDArray[np.float32]) -> Numbers:
    return tuple(map(float, values))
