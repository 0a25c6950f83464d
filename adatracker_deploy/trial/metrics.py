"""The paper's metrics as pure functions: MR, EL, and AR where the truth is known.

Source: AdaTracker, section "Experimental Setup" (task setting, evaluation metrics), with its gaps closed:

* The paper sums R from t = 0 to L and divides by L, so that a perfect trial would exceed 1 and the reference
  box would score itself. Here the step that gives the reference is left out: L + 1 ticks give L scored steps.
* A step without a box has R = 0. Leaving lost steps out would turn a trial that sees its target for one tenth
  of the time into a good one; what it would say is reported beside it, as `mr_visible` and `visibility`.
* A trial ends at the 50th lost step in a row.

What the paper prints and what its simulator's code does instead are `Rules`.
"""

from __future__ import annotations

import dataclasses
import math
import statistics
from dataclasses import dataclass
from itertools import islice
from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from adatracker_deploy.messages import Box

DESIRED_DISTANCE_M = 2.5
"""rho* of the task setting."""
MAX_DISTANCE_M = 7.5
"""rho_max: the reward's scale, and as far as a target counts as visible."""
MAX_BEARING_RAD = math.radians(45.0)
"""theta_max: the reward's scale, and half of the 90 degree field of view."""
MAX_LOST_STEPS = 50
"""So many lost steps in a row end a trial."""


def step_reward(distance_m: float, bearing_rad: float) -> float:
    """Return the task's reward, 1 - |rho - 2.5| / 7.5 - |theta| / 45 deg: at most 1, unbounded below.

    Args:
        distance_m: horizontal distance to the target.
        bearing_rad: its bearing from the robot's heading, in (-pi, pi].
    """
    return 1.0 - abs(distance_m - DESIRED_DISTANCE_M) / MAX_DISTANCE_M - abs(bearing_rad) / MAX_BEARING_RAD


def target_visible(distance_m: float, bearing_rad: float, in_mask: bool) -> bool:
    """Tell whether a step counts as seen in simulation: within 7.5 m and 90 degrees, and in the mask."""
    return in_mask and distance_m <= MAX_DISTANCE_M and abs(bearing_rad) <= MAX_BEARING_RAD


def box_reward(box: Box, reference: Box) -> float:
    """Return R = 1 / (1 + |c - c_ref| + |(w, h) - (w, h)_ref|), L2 norms of normalised boxes; in (0, 1]."""
    centre = math.hypot(box.cx - reference.cx, box.cy - reference.cy)
    size = math.hypot(box.w - reference.w, box.h - reference.h)
    return 1.0 / (1.0 + centre + size)


def ticks_until_lost(seen: Iterable[bool], max_lost_steps: int = MAX_LOST_STEPS) -> int | None:
    """Return how many ticks pass up to and with the one that ends a trial as lost, or None if none does."""
    lost = 0
    for ticks, visible in enumerate(seen, start=1):
        lost = 0 if visible else lost + 1
        if lost >= max_lost_steps:
            return ticks
    return None


@dataclass(frozen=True, slots=True, kw_only=True)
class Rules:
    """How to score; the defaults are this toolkit's."""

    max_lost_steps: int = MAX_LOST_STEPS
    """So many lost steps in a row end a trial; at least 1. The published simulator's code says 51."""
    count_reference: bool = False
    """Sum R from the reference itself, R = 1, as the paper prints its formula: a perfect trial exceeds 1."""
    least_reward: float = -math.inf
    """No step's reward in AR is less. The published simulator's code says -1."""


class ScorableStep(Protocol):
    """What scoring needs of a tick; `StepRecord` and `ScoredStep` have it."""

    @property
    def step(self) -> int:
        """From 0."""

    @property
    def box(self) -> Box | None:
        """Normalised; None while lost."""

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
    """Mean R over the scored steps, lost ones as 0; in [0, 1], but for `Rules.count_reference`. 0 when the
    trial ended before its first."""
    mr_visible: float | None
    """Mean R over the steps with a box; None without any."""
    visibility: float
    """Share of the scored steps with a box; in [0, 1]."""
    el: int
    """Episode length: steps until the trial ended."""
    ar: float | None = None
    """Accumulated reward; None where the truth is unknown."""
    lost: bool = False
    """It ended by the rule of lost steps."""
    ticks: int = 0
    """That were scored, the reference's included; what came after the end was not."""
    bad_boxes: int = 0
    """Boxes that are none (not finite, without a size), counted as lost."""


def is_box(box: Box) -> bool:
    """Tell whether a box has finite numbers and a size."""
    return box.w > 0 and box.h > 0 and math.isfinite(box.cx + box.cy + box.w + box.h)


def score_boxes(boxes: Sequence[Box | None], rules: Rules = DEFAULT_RULES) -> Score:
    """Score one box a tick, None where the target is lost; the first box is the reference.

    Ticks before the first box count as lost, and so does a box that is none. Ticks after the end of the
    trial, by the rule of lost steps, do not count at all.
    """
    seen = [box if box is not None and is_box(box) else None for box in boxes]
    end = ticks_until_lost((box is not None for box in seen), rules.max_lost_steps)
    visible = [box for box in seen[:end] if box is not None]
    rewards = [box_reward(box, visible[0]) for box in visible[1:]]
    ticks = len(seen[:end])
    el = max(0, ticks - 1)
    total = math.fsum(rewards) + (1.0 if rules.count_reference and visible else 0.0)
    return Score(
        mr=total / el if el else 0.0,
        mr_visible=statistics.fmean(rewards) if rewards else None,
        visibility=len(rewards) / el if el else 0.0,
        el=el,
        lost=end is not None,
        ticks=ticks,
        bad_boxes=sum(box is not None for box in boxes[:ticks]) - len(visible),
    )


def score_steps(records: Sequence[ScorableStep], rules: Rules = DEFAULT_RULES) -> Score:
    """Score a trial's log, ordered by step; AR is the sum of the reward over all steps after the first tick.

    A tick that is missing from the log (a busy writer drops rather than delays) is one tick fewer in every
    mean; `el` counts it, because the steps carry their numbers.
    """
    score = score_boxes([record.box for record in records], rules)
    if not records:
        return score
    rewards = [
        max(step_reward(record.distance_m, record.bearing_rad), rules.least_reward)
        for record in islice(records, 1, score.ticks)
        if record.distance_m is not None and record.bearing_rad is not None
    ]
    return dataclasses.replace(
        score, el=records[score.ticks - 1].step, ar=math.fsum(rewards) if rewards else None
    )
