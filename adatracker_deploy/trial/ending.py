"""The end of a trial, its step and its outcome: by its log, or by what the operator marked since."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple, cast

from adatracker_deploy.trial.marks import holding

if TYPE_CHECKING:
    from collections.abc import Sequence

    from adatracker_deploy.core.record import Outcome, ScoredStep, StepRecord
    from adatracker_deploy.trial.reader import ScoredTrial, Trial

_KILLED = "the log ends without a summary: the run was killed, or its disk ran full"


class Ending(NamedTuple):
    """The outcome that holds, why in words (may be empty), and how many ticks the trial lasted."""

    outcome: Outcome
    reason: str
    ticks: int


def recorded_outcome(trial: Trial | ScoredTrial) -> Outcome:
    """Return the outcome that the run wrote; ``system_fault`` for a log without its summary."""
    return cast("Outcome", trial.summary["outcome"]) if trial.summary else "system_fault"


def ending(trial: Trial | ScoredTrial) -> Ending:
    """Return how a trial ended; an outcome that the operator marked holds instead of the recorded one.

    For a trial with a takeover this is how the run ended after it, unless the operator marked more than the
    takeover that is recorded anyway.
    """
    recorded, held = recorded_outcome(trial), holding(trial.marks)
    if held and not (held[0] == recorded == "takeover" and held[1].since_s is None):
        outcome, mark = held
        return Ending(outcome, mark.note or "marked by the operator", _until(trial.steps, mark.since_s))
    if trial.summary is None:
        return Ending(recorded, _KILLED, len(trial.steps))
    run = trial.summary.get("ended") or trial.summary
    return Ending(run["outcome"], run.get("reason", ""), len(trial.steps))


def _until(steps: Sequence[StepRecord | ScoredStep], since_s: float | None) -> int:
    """Count the ticks of a trial's first `since_s` seconds; all of them for None."""
    if since_s is None:
        return len(steps)
    return sum(step.t_ns <= steps[0].t_ns + since_s * 1e9 for step in steps)
