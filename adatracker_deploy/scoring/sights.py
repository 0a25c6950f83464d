"""Scores of a trial's perception, by the truth that a virtual world knows of each picture."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING, Any

from adatracker_deploy.core.sight import Verdict
from adatracker_deploy.core.task import is_box
from adatracker_deploy.scoring.metrics import Scorer
from adatracker_deploy.scoring.stats.running import RunningQuantiles, RunningSum

if TYPE_CHECKING:
    from adatracker_deploy.core.record import ScoredStep, StepRecord


VERDICTS = {verdict.value: verdict for verdict in Verdict}


class SightTally:
    """Takes a trial's ticks, ordered by step; stale ones and those without a truth say nothing."""

    def __init__(self) -> None:
        self._verdicts: Counter[Verdict] = Counter()
        self._shown = 0
        self._mask_iou, self._box_iou = RunningSum(), RunningSum()
        self._true = Scorer()
        self._unseen_since_ns: int | None = None
        self._found_again_s, self._times = RunningQuantiles(), 0

    def add(self, step: StepRecord | ScoredStep) -> None:
        """Take the next tick."""
        verdict = VERDICTS.get(step.sight or "")
        if verdict is None or step.stale:
            return
        shown = step.true_box is not None and is_box(step.true_box)
        self._verdicts[verdict] += 1
        self._true.add_box(step.true_box)
        self._shown += shown
        if verdict is Verdict.SEEN:
            if step.mask_iou is not None and 0.0 <= step.mask_iou <= 1.0:
                self._mask_iou.add(step.mask_iou)
            if step.box is not None and step.true_box is not None and shown and is_box(step.box):
                self._box_iou.add(step.box.iou(step.true_box))
            if self._unseen_since_ns is not None:
                self._found_again_s.add((step.t_ns - self._unseen_since_ns) / 1e9)
                self._times += 1
            self._unseen_since_ns = None
        elif not shown:
            self._unseen_since_ns = None
        elif self._unseen_since_ns is None:
            self._unseen_since_ns = step.t_ns

    def summary(self) -> dict[str, Any] | None:
        """Return the shares of the ticks by verdict, and more; None where the truth was not known.

        `seen` is a share of the ticks that show the target, the others of all; `mask_iou` and `box_iou` are
        means of those in which it was seen; `found_again_s` is how long a target in the picture was not
        seen; `mr_true` is MR by the true boxes.
        """
        ticks = self._verdicts.total()
        if not ticks:
            return None
        again = self._found_again_s.quantiles((0.5, 1.0)) or (None, None)
        return {
            **{verdict.value: self._verdicts[verdict] / ticks for verdict in Verdict},
            "seen": self._verdicts[Verdict.SEEN] / self._shown if self._shown else None,
            "mask_iou": _mean(self._mask_iou),
            "box_iou": _mean(self._box_iou),
            "found_again_s": {"times": self._times, "p50": again[0], "max": again[1]},
            "mr_true": self._true.score().mr,
        }


def _mean(values: RunningSum) -> float | None:
    return values.total() / values.count if values.count else None
