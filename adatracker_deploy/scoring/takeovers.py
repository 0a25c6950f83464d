"""Takeovers, as the field counts them: how far and how long the policy drove for each.

The rate is that of California's disengagement reports (13 CCR 227.50, whose numbers are read as miles per
disengagement): what was driven autonomously, divided by how often somebody took over. It is a ratio of sums
over all trials and not a mean of trials' ratios, and a trial without a takeover adds what it drove. Without
any takeover there is no rate: what was driven is a lower bound.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from adatracker_deploy.core.record import BY_HAND

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from adatracker_deploy.core.record import ScoredStep, StepRecord

_FARTHEST_M = 1e6
"""Between two ticks; what is farther, or no number, is damage in a log."""


class TakeoverTally:
    """Takes all ticks of a trial, ordered by step; what is between two ticks is the first one's driver's."""

    def __init__(self) -> None:
        self._before: StepRecord | ScoredStep | None = None
        self._by_hand = 0
        self._ns = {False: 0, True: 0}
        self._metres = {False: 0.0, True: 0.0}
        self._placed = False

    def add(self, step: StepRecord | ScoredStep) -> None:
        """Take the next tick."""
        before, self._before = self._before, step
        if before is None:
            return
        was_hand = before.driver == BY_HAND
        self._ns[was_hand] += step.t_ns - before.t_ns
        if before.pose is not None and step.pose is not None:
            there, here = before.pose, step.pose
            went = math.dist((there.x, there.y, there.z), (here.x, here.y, here.z))
            if went <= _FARTHEST_M:
                self._placed = True
                self._metres[was_hand] += went
        self._by_hand += step.driver == BY_HAND and not was_hand

    def summary(self, *, ended_so: bool) -> dict[str, Any]:
        """Return counts, what was driven (s, m) by policy and hand, and the policy's per takeover.

        Lengths are by the robot's odometry, None where it reports none.

        Args:
            ended_so: the trial ended by a takeover, which counts unless the hand drove already.
        """
        drove_last = self._before is not None and self._before.driver == BY_HAND
        placed = self._placed
        return rates(
            {
                "count": self._by_hand + (ended_so and not drove_last),
                "by_hand": self._by_hand,
                "policy_s": self._ns[False] / 1e9,
                "policy_m": self._metres[False] if placed else None,
                "hand_s": self._ns[True] / 1e9,
                "hand_m": self._metres[True] if placed else None,
            }
        )


def together(found: Iterable[Mapping[str, Any]]) -> dict[str, Any] | None:
    """Return several trials' takeovers as one; None for no trial. A length counts if every trial has it."""
    rows = list(found)
    if not rows:
        return None
    sums: dict[str, Any] = {
        key: None if any(row[key] is None for row in rows) else sum(row[key] for row in rows)
        for key in ("count", "by_hand", "policy_s", "policy_m", "hand_s", "hand_m")
    }
    return rates(sums)


def rates(sums: dict[str, Any]) -> dict[str, Any]:
    """Return sums with `between_s` and `between_m`: the policy's per takeover, None without any."""
    count = sums["count"]
    return sums | {
        f"between_{unit}": driven / count if count and driven is not None else None
        for unit, driven in (("s", sums["policy_s"]), ("m", sums["policy_m"]))
    }
