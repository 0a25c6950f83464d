"""Compares logged and replayed answers: the first that differs in any bit, and the size of the
differences."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from adatracker_deploy.core.messages import ZERO
from adatracker_deploy.core.record import BY_HAND
from adatracker_deploy.policy.base import to_twist

if TYPE_CHECKING:
    from collections.abc import Sequence

    from adatracker_deploy.config.limits import Limits
    from adatracker_deploy.core.messages import Twist
    from adatracker_deploy.policy.base import ActionSpec
    from adatracker_deploy.replay.answers import Answer, Numbers

AXES = {"vx": "m/s", "vy": "m/s", "vz": "m/s", "yaw_rate": "rad/s"}
"""The fields of a `Twist`, with their units."""


@dataclass(frozen=True, slots=True)
class Difference:
    """The first number that differs."""

    step: int
    what: Literal["action", "z"]
    place: int
    """Index of the number in the action or in z; -1 if their lengths differ."""
    logged: float
    replayed: float

    @property
    def by(self) -> float:
        """The difference; NaN if one of them is, or if their counts differ."""
        return abs(self.replayed - self.logged)

    @property
    def words(self) -> str:
        """The difference in words for people."""
        if self.place < 0:
            return f"tick {self.step}, {self.what}: {self.replayed:g} numbers, in the log {self.logged:g}"
        amount = f"by {self.by:.2g}" if math.isfinite(self.by) else "one of them is not finite"
        where = f"tick {self.step}, {self.what}[{self.place}]"
        return f"{where}: logged {self.logged:.9g}, now {self.replayed:.9g}, {amount}"


@dataclass(frozen=True, slots=True)
class Spread:
    """Magnitude of the difference between two time series; NaN counts as infinite."""

    mean: float
    most: float
    at: int
    """The tick of the largest."""

    @classmethod
    def of(cls, ticks: Sequence[int], before: Sequence[float], after: Sequence[float]) -> Spread:
        """Measure two courses of equal length, at least one tick long."""
        apart = [
            0.0 if a == b or (math.isnan(a) and math.isnan(b)) else abs(b - a)
            for a, b in zip(before, after, strict=True)
        ]
        apart = [math.inf if math.isnan(value) else value for value in apart]
        most = max(apart)
        mean = math.fsum(value / len(apart) for value in apart) if math.isfinite(most) else math.inf
        return cls(mean, most, ticks[apart.index(most)])


def first_difference(answers: Sequence[Answer]) -> Difference | None:
    """Return the first number of an answer that has not the logged one's bits; any NaN is like any other."""
    for answer in answers:
        pairs: tuple[tuple[Literal["action", "z"], Numbers, Numbers], ...] = (
            ("z", answer.step.context, answer.context),  # z first: the action follows from it
            ("action", answer.step.action, answer.action),
        )
        for what, logged, replayed in pairs:
            if len(logged) != len(replayed):
                return Difference(answer.step.step, what, -1, len(logged), len(replayed))
            differs = np.flatnonzero(_bits(logged) != _bits(replayed))
            if differs.size:
                place = int(differs[0])
                return Difference(answer.step.step, what, place, logged[place], replayed[place])
    return None


def logged_commands(answers: Sequence[Answer], spec: ActionSpec, limits: Limits) -> list[Twist]:
    """Return what the logged answers asked of a robot: the logged commands, but where the hand drove.

    There the action is turned into a velocity by `spec`; one of another length asks for nothing.
    """
    return [
        answer.step.command if answer.step.driver != BY_HAND else _unheeded(answer.step.action, spec, limits)
        for answer in answers
    ]


def _unheeded(action: Numbers, spec: ActionSpec, limits: Limits) -> Twist:
    return to_twist(np.array(action, np.float32), spec, limits) if len(action) == len(spec) else ZERO


def commands(answers: Sequence[Answer], spec: ActionSpec, limits: Limits) -> list[Twist]:
    """Return what the answers ask of a robot of these limits."""
    return [to_twist(np.array(answer.action, np.float32), spec, limits) for answer in answers]


def apart(ticks: Sequence[int], before: Sequence[Twist], after: Sequence[Twist]) -> dict[str, Spread]:
    """Return how far two courses of velocities lie apart, by axis; without those that neither uses.

    Args:
        ticks: their numbers.
        before: one course.
        after: the other, as long.
    """
    found = {}
    for axis in AXES:
        a, b = ([getattr(twist, axis) for twist in course] for course in (before, after))
        if any((*a, *b)):
            found[axis] = Spread.of(ticks, a, b)
    return found


def context_apart(answers: Sequence[Answer]) -> Spread | None:
    """Return how far the contexts lie apart, by their largest number; None where they are not alike."""
    known = [
        answer for answer in answers if answer.context and len(answer.context) == len(answer.step.context)
    ]
    if not known or len(known) < len(answers):
        return None
    far = [
        float(np.max(np.abs(np.subtract(answer.context, answer.step.context)), initial=0.0))
        for answer in known
    ]
    return Spread.of([answer.step.step for answer in known], [0.0] * len(far), far)


def _bits(numbers: Numbers) -> np.ndarray[tuple[int], np.dtype[np.uint32]]:
    with np.errstate(over="ignore"):  # no policy gives values larger than a float32
        values = np.array(numbers, np.float32)
    values[np.isnan(values)] = np.nan  # the log does not tell one NaN from another
    return values.view(np.uint32)
