"""Summaries of a log, a box file or a set of trials: the JSON that runs and `score` print."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING

from adatracker_deploy.scoring.metrics import DEFAULT_RULES, Rules, score_boxes
from adatracker_deploy.scoring.stats.intervals import mean_estimate, mean_std, share_estimate
from adatracker_deploy.scoring.stats.survival import kaplan_meier, median_duration
from adatracker_deploy.scoring.takeovers import together
from adatracker_deploy.scoring.tally import Summary, Tally
from adatracker_deploy.trial.ending import ending, recorded_outcome
from adatracker_deploy.trial.marks import said

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence
    from pathlib import Path

    from adatracker_deploy.scoring.box_file import BoxTrack
    from adatracker_deploy.trial.reader import ScoredTrial, Trial


def summarise_log(trial: Trial | ScoredTrial, rules: Rules = DEFAULT_RULES) -> Summary:
    """Sum up a trial from its log alone, as the run itself did at its end.

    A log without the run's own summary is that of a run that died: outcome ``system_fault``. `episode` says
    what a rehearsal was dealt; trials of equal episodes can be compared in pairs. An outcome that the
    operator marked holds instead of `recorded_outcome`, and the trial ends when the mark says that it did.
    """
    outcome, reason, ticks = ending(trial)
    summary = Tally(trial.steps[:ticks], rules).summary(
        platform=trial.platform,
        policy=trial.policy,
        outcome=outcome,
        reason=reason,
        steps=trial.planned_steps,
        stop_s=trial.summary.get("stop_s") if trial.summary else None,
        trial=trial.path.parent,
    )
    dealt = {key: trial.config.get(key) for key in ("seed", "scene", "target_speed_m_s")}
    return {
        **summary,
        "kind": trial.kind,
        "episode": dealt if trial.kind == "sitl" and dealt["seed"] is not None else None,
        "complete": trial.complete,
        "recorded_outcome": recorded_outcome(trial),
        "marks": [said(mark) for mark in trial.marks],
    }


def summarise_boxes(track: BoxTrack, path: Path, rules: Rules = DEFAULT_RULES) -> Summary:
    """Sum up a plain file of boxes, which knows no robot, and whose own end is its horizon."""
    score = score_boxes(track.boxes, rules)
    return {
        "platform": None,
        "policy": None,
        "outcome": "lost" if score.lost else "completed",
        "mr": score.mr,
        "mr_visible": score.mr_visible,
        "visibility": score.visibility,
        "el": score.el,
        "ar": None,
        "steps": len(track.boxes) - 1,
        "rate_hz": track.rate_hz,
        "seconds": score.el / track.rate_hz if track.rate_hz else None,
        "trial": str(path),
        "bad_boxes": score.bad_boxes,
        "assumed_size": track.assumed_size,
    }


def summarise_set(summaries: Sequence[Summary]) -> Summary:
    """Put several trials together: `trials`, and what `statistics_of` says of them.

    Where there are several platforms or policies, `groups` says it of each.

    """
    groups = by_method(summaries)
    table: Summary = {"trials": list(summaries), **statistics_of(summaries)}
    if len(groups) > 1:
        table["groups"] = [
            {"platform": platform, "policy": policy, **statistics_of(group)}
            for (platform, policy), group in groups.items()
        ]
    return table


def statistics_of(summaries: Sequence[Summary]) -> Summary:
    """Return `mean`, `std` and 95 % `interval` of mr, el and sr, of ar if all have it; and how trials ended.

    SR is the share of trials that were completed. The std is the sample's (ddof = 1); one trial has None.
    Trials that are not `counted` are left out, and their number is `left_out`; where none is left, means are
    None. Intervals are Student's, SR's is Wilson's; a bound that does not exist is None. `outcomes` counts,
    `censored` says how many trials reached the horizon, so that their EL is a lower bound, and `survival` is
    the Kaplan-Meier curve of EL, by its falls, with its median where it reaches one half. `takeovers` puts
    theirs together.
    """
    left_out = len(summaries)
    summaries = counted(summaries)
    left_out -= len(summaries)
    if not summaries:
        return _NOTHING | {"left_out": left_out}
    values = columns_of(summaries)
    spread = {key: mean_std(column) for key, column in values.items()}
    completed = [row["outcome"] == "completed" for row in summaries]
    estimates = {key: mean_estimate(column) for key, column in values.items()}
    estimates["sr"] = share_estimate(sum(completed), len(completed))
    falls = kaplan_meier([row["el"] for row in summaries], [not done for done in completed])
    return {
        "mean": {key: mean for key, (mean, _) in spread.items()},
        "std": {key: std for key, (_, std) in spread.items()},
        "interval": {key: estimate.bounds for key, estimate in estimates.items()},
        "outcomes": dict(Counter(row["outcome"] for row in summaries)),
        "censored": sum(completed),
        "survival": [
            {"el": fall.at, "at_risk": fall.at_risk, "failed": fall.failed, "survival": fall.survival}
            for fall in falls
        ],
        "median_el": median_duration(falls),
        "left_out": left_out,
        "takeovers": together(row["takeovers"] for row in summaries if row.get("takeovers")),
    }


_NOTHING: Summary = {
    "mean": dict.fromkeys(("mr", "el", "sr")),
    "std": dict.fromkeys(("mr", "el", "sr")),
    "interval": dict.fromkeys(("mr", "el", "sr"), (None, None)),
    "outcomes": {},
    "censored": 0,
    "survival": [],
    "median_el": None,
    "takeovers": None,
}


def counted(summaries: Iterable[Summary]) -> list[Summary]:
    """Return the trials that count in means: those whose timing was kept, unless all were asked for."""
    return [row for row in summaries if row.get("counted", True)]


def columns_of(summaries: Sequence[Summary]) -> dict[str, list[float]]:
    """Return the metrics' values by name; ar only if every trial has it."""
    columns: dict[str, list[float]] = {
        "mr": [row["mr"] for row in summaries],
        "el": [row["el"] for row in summaries],
        "sr": [float(row["outcome"] == "completed") for row in summaries],
    }
    if all(row["ar"] is not None for row in summaries):
        columns["ar"] = [row["ar"] for row in summaries]
    return columns


def timing_words(row: Summary) -> str:
    """Say of a trial how its timing was not kept."""
    return (
        f"its timing was not kept: {row['missed_deadlines']} slots missed in {row['el']} steps, "
        f"{row['stale']:.0%} of its ticks stale"
    )


def by_method(summaries: Iterable[Summary]) -> dict[tuple[str | None, str | None], list[Summary]]:
    """Sort trials by platform and policy, in the order in which they first come."""
    groups: dict[tuple[str | None, str | None], list[Summary]] = {}
    for row in summaries:
        groups.setdefault((row["platform"], row["policy"]), []).append(row)
    return groups
