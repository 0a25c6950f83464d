"""The paper's metrics as pure functions: MR, EL, and AR where the truth is known.

Source: AdaTracker, section "Experimental Setup" (task setting, evaluation metrics), with its gaps closed:

* The paper sums R from t = 0 to L and divides by L, so that a perfect trial would exceed 1 and the reference
  box would score itself. Here the step that gives the reference is left out: L + 1 ticks give L scored steps.
* A step whose newest frame was too old to act on (stale) does not count: it is neither seen nor lost, and
  one step fewer in MR. How many there were is said.
* A step that looked and found no box has R = 0. Leaving lost steps out would turn a trial that sees its
  target for one tenth of the time into a good one; what it would say is reported beside it, as `mr_visible`
  and `visibility`.
* A trial ends at the 50th lost step in a row.

What the paper prints and what its simulator's code does instead are `Rules`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

from adatracker_deploy.core.task import MAX_LOST_STEPS, box_reward, is_box, step_reward
from adatracker_deploy.scoring.stats.running import RunningSum

if TYPE_CHECKING:
    from collections.abc import Iterable

    from adatracker_deploy.core.messages import Box


@dataclass(frozen=True, slots=True, kw_only=True)
class Rules:
    """The rules of scoring; the defaults are this toolkit's."""

    max_lost_steps: int = MAX_LOST_STEPS
    """So many lost steps in a row end a trial; at least 1. The published simulator's code says 51."""
    count_reference: bool = False
    """Sum R from the reference itself, R = 1, as the paper prints its formula: a perfect trial exceeds 1."""
    least_reward: float = -math.inf
    """No step's reward in AR is less. The published simulator's code says -1."""


class ScorableStep(Protocol):
    """The fields of a tick that scoring needs; `StepRecord` and `ScoredStep` have them."""

    @property
    def step(self) -> int:
        """From 0."""

    @property
    def box(self) -> Box | None:
        """Normalised; None while lost."""

    @property
    def stale(self) -> bool:
        """Nothing fresh enough was seen."""

    @property
    def distance_m(self) -> float | None:
        """Truth, horizontal."""

    @property
    def bearing_rad(self) -> float | None:
        """Truth, positive to the left."""


DEFAULT_RULES = Rules()


@dataclass(frozen=True, slots=True, kw_only=True)
class Score:
    """One trial in numbers."""

    mr: float
    """Mean R over the scored steps but the stale, lost ones as 0; in [0, 1], but for `Rules.count_reference`.
    0 when the trial ended before its first."""
    mr_visible: float | None
    """Mean R over the steps with a box; None without any."""
    visibility: float
    """Share of the scored steps but the stale with a box; in [0, 1]."""
    el: int
    """Episode length: steps until the trial ended."""
    ar: float | None = None
    """Accumulated reward; None where the truth is unknown."""
    lost: bool = False
    """It ended by the rule of lost steps."""
    ticks: int = 0
    """That were scored, the reference's included; what came after the end was not."""
    stale: int = 0
    """Ticks whose newest frame was too old to act on."""
    bad_boxes: int = 0
    """Invalid boxes (not finite, without a size), counted as lost."""


class Scorer:
    """Scores a trial tick by tick, in the same memory however long it lasts.

    The first box is the reference. Ticks before it count as lost, and so do invalid boxes. Ticks after
    the end of the trial, by the rule of lost steps, do not count at all. Stale ticks neither end a run of
    lost steps nor lengthen it.
    """

    def __init__(self, rules: Rules = DEFAULT_RULES) -> None:
        self.rules = rules
        self._reference: Box | None = None
        self._box_rewards, self._rewards = RunningSum(), RunningSum()
        self._ticks, self._el, self._lost_in_a_row, self._bad_boxes = 0, 0, 0, 0
        self._stale = 0

    @property
    def lost(self) -> bool:
        """Whether the rule of lost steps has ended the trial."""
        return self._lost_in_a_row >= self.rules.max_lost_steps

    def add_box(self, box: Box | None) -> None:
        """Take the next tick of a trial of which only boxes are known."""
        if not self.lost:
            self._el = self._ticks
            self._see(box)

    def add_step(self, step: ScorableStep) -> None:
        """Take the next tick of a log, ordered by step.

        A tick that is missing from the log (a busy writer drops rather than delays) is one tick fewer in
        every mean; `el` counts it, because the steps carry their numbers.
        """
        if self.lost:
            return
        if self._ticks and step.distance_m is not None and step.bearing_rad is not None:
            self._rewards.add(max(step_reward(step.distance_m, step.bearing_rad), self.rules.least_reward))
        self._el = step.step
        if step.stale:
            self._ticks, self._stale = self._ticks + 1, self._stale + 1
        else:
            self._see(step.box)

    def score(self) -> Score:
        """Return what the ticks so far come to; AR is the sum of the reward over all but the first."""
        scored, seen = max(0, self._ticks - self._stale - 1), self._box_rewards.count
        found = self._box_rewards.total()
        total = found + (1.0 if self.rules.count_reference and self._reference is not None else 0.0)
        return Score(
            mr=total / scored if scored else 0.0,
            mr_visible=found / seen if seen else None,
            visibility=seen / scored if scored else 0.0,
            el=self._el,
            ar=self._rewards.total() if self._rewards.count else None,
            lost=self.lost,
            ticks=self._ticks,
            stale=self._stale,
            bad_boxes=self._bad_boxes,
        )

    def _see(self, box: Box | None) -> None:
        self._ticks += 1
        if box is not None and not is_box(box):
            self._bad_boxes += 1
            box = None
        self._lost_in_a_row = 0 if box is not None else self._lost_in_a_row + 1
        if box is None:
            return
        if self._reference is None:
            self._reference = box
        else:
            self._box_rewards.add(box_reward(box, self._reference))


def score_boxes(boxes: Iterable[Box | None], rules: Rules = DEFAULT_RULES) -> Score:
    """Score one box a tick, None where the target is lost."""
    scorer = Scorer(rules)
    for box in boxes:
        scorer.add_box(box)
    return scorer.score()
