"""Accumulates a trial's metrics tick by tick, live or from its log, with the same result."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from adatracker_deploy.core.record import BY_HAND
from adatracker_deploy.scoring.metrics import DEFAULT_RULES, Rules, Scorer
from adatracker_deploy.scoring.sights import SightTally
from adatracker_deploy.scoring.stages import FAR_STAGES, STAGES, LatencyPercentiles
from adatracker_deploy.scoring.takeovers import TakeoverTally

if TYPE_CHECKING:
    from collections.abc import Iterable
    from pathlib import Path

    from adatracker_deploy.core.record import Outcome, ScoredStep, StepRecord

Summary = dict[str, Any]
"""Keys are a contract: more may be added, none is renamed. Lengths in m, times in s unless a key says ms."""
TIMING_TOLERANCE = 0.1
"""The largest share of the loop's slots that may go by unused, missed or stale, in a trial whose timing was
kept: the rate at which it acted is then within this of the policy's."""


class Tally:
    """A trial's scores, in the same memory however long it lasts: it keeps none of its ticks.

    What is said of the policy ends where somebody takes over by hand, or chooses another target, as if that
    had ended the trial; only `takeovers` and `chosen_again` go on. A trial that the hand drives from the
    start is scored whole, as the hand's, unless another target is chosen.

    Args:
        steps: ticks to begin with, ordered by step; each is what `add` takes.
        rules: how to score.
    """

    def __init__(self, steps: Iterable[StepRecord | ScoredStep] = (), rules: Rules = DEFAULT_RULES) -> None:
        self._scorer = Scorer(rules)
        self._sights = SightTally()
        self._takeovers = TakeoverTally()
        self._by_hand = False
        """The hand drives from the start."""
        self._ended_by: str | None = None
        """The operator's act that ended the part scored for the policy, and when; None before."""
        self._picks_before, self._picks = 0, 0
        self._latencies = LatencyPercentiles(("sensor_to_command", "lateness", *STAGES, *FAR_STAGES))
        self._first_step, self._first_ns = 0, 0
        self._last_step, self._last_ns = 0, 0
        self._missed_deadlines = 0
        self._ticks = 0
        self._stale, self._stale_at_the_end = 0, 0
        for step in steps:
            self.add(step)

    def add(self, step: StepRecord | ScoredStep) -> None:
        """Take the next tick; those after the end of a trial, by the rule of lost steps, do not count."""
        if not self._ticks:
            self._first_step, self._first_ns = step.step, step.t_ns
            self._by_hand = step.driver == BY_HAND
            self._picks_before = step.picks or 0
        self._ticks += 1
        if self._scorer.lost:
            return
        self._takeovers.add(step)
        self._picks = max(self._picks, (step.picks or 0) - self._picks_before)
        if self._ended_by is None and step.driver == BY_HAND and not self._by_hand:
            self._ended_by = f"taken over by hand at step {step.step}"
        if self._ended_by is None and self._picks:
            self._ended_by = f"the operator chose another target at step {step.step}"
        if self._ended_by is not None:
            return
        self._scorer.add_step(step)
        self._sights.add(step)
        self._latencies.add(step.latency)
        self._last_step, self._last_ns = step.step, step.t_ns
        self._missed_deadlines = step.missed_deadlines
        self._stale += step.stale
        self._stale_at_the_end = self._stale_at_the_end + 1 if step.stale else 0

    def summary(
        self,
        *,
        platform: str,
        policy: str,
        outcome: Outcome,
        reason: str,
        steps: int,
        stop_s: float | None,
        trial: Path,
    ) -> Summary:
        """Sum up what came so far.

        Args:
            platform: the robot's name.
            policy: the policy's name.
            outcome: how it ended.
            reason: why, in words; may be empty.
            steps: the planned horizon; `el` says how many were reached.
            stop_s: from the stop to standstill; None where the robot was not moving.
            trial: its folder.

        `stale` is the share of ticks whose newest frame, or whose policy's answer, was too old to act on.
        `far_ms` is of policies on another machine. `timing_kept` is false where more than
        `TIMING_TOLERANCE` of the slots were missed or stale: such a trial says little of the
        policy, and is not `counted` in means (`score --all` counts it). `sight` is what the eyes were worth,
        see `SightTally.summary`.
        Where the rules end the trial sooner than it ended, it was lost. Where somebody took over by hand, or
        chose another target, its outcome is `takeover`. `ended` is how it ended before these rules.
        `takeovers` is of the whole trial, see `TakeoverTally.summary`; so is `chosen_again`, how often the
        operator chose another target after the first tick.
        """
        ended = {"outcome": outcome, "reason": reason}
        takeovers = self._takeovers.summary(ended_so=outcome == "takeover")
        score = self._scorer.score()
        if score.lost and (score.ticks < self._ticks or outcome == "completed"):
            lost_steps = self._scorer.rules.max_lost_steps
            outcome, reason = "lost", f"scored so: the target was not seen for {lost_steps} steps"
        elif self._ended_by is not None:
            told = f" ({reason})" if reason else ""
            reason = f"{self._ended_by}; the run ended as {outcome}{told}"
            outcome = "takeover"
        seconds = (self._last_ns - self._first_ns) / 1e9
        found = self._latencies.found()
        kept = self._timing_kept()
        return {
            "platform": platform,
            "policy": policy,
            "outcome": outcome,
            "mr": score.mr,
            "mr_visible": score.mr_visible,
            "visibility": score.visibility,
            "el": score.el,
            "ar": score.ar,
            "steps": steps,
            "rate_hz": (self._last_step - self._first_step) / seconds if seconds > 0 else None,
            "seconds": seconds,
            "latency_ms": found["sensor_to_command"],
            "stages_ms": {stage: found[stage] for stage in STAGES},
            "far_ms": {stage: found[stage] for stage in FAR_STAGES},
            "lateness_ms": found["lateness"],
            "missed_deadlines": self._missed_deadlines,
            "stop_s": stop_s,
            "reason": reason,
            "trial": str(trial),
            "bad_boxes": score.bad_boxes,
            "stale": score.stale / score.ticks if score.ticks else 0.0,
            "timing_kept": kept,
            "counted": kept,
            "sight": self._sights.summary(),
            "takeovers": takeovers,
            "chosen_again": self._picks,
            "ended": ended,
        }

    def _timing_kept(self) -> bool:
        """Return whether the trial acted at the policy's rate; the stale ticks of its end do not count."""
        slots = self._last_step - self._first_step + 1 + self._missed_deadlines
        unused = self._missed_deadlines + self._stale - self._stale_at_the_end
        return unused <= TIMING_TOLERANCE * slots
