"""What a trial, and a set of trials, came to: the JSON that runs and `score` print, and the tables.

Keys are a contract: more may be added, none is renamed. Lengths are in m, times in s unless the key says ms.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from rich import box
from rich.console import Group
from rich.table import Table
from rich.text import Text

from adatracker_deploy.stats.intervals import mean_std
from adatracker_deploy.trial.metrics import score_boxes, score_steps

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence
    from pathlib import Path

    from rich.console import RenderableType

    from adatracker_deploy.messages import Box
    from adatracker_deploy.trial.reader import Trial
    from adatracker_deploy.trial.record import Outcome, StepRecord

Summary = dict[str, Any]


def summarise(
    records: Sequence[StepRecord],
    *,
    platform: str,
    policy: str,
    outcome: Outcome,
    reason: str,
    steps: int,
    stop_s: float | None,
    trial: Path,
) -> Summary:
    """Sum up one trial.

    Args:
        records: its ticks, ordered by step.
        platform: the robot's name.
        policy: the policy's name.
        outcome: how it ended.
        reason: why, in words; may be empty.
        steps: the planned horizon; `el` says how many were reached.
        stop_s: from the stop to standstill; None where the robot was not moving.
        trial: its folder.
    """
    score = score_steps(records)
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
        **_timing(records),
        "stop_s": stop_s,
        "reason": reason,
        "trial": str(trial),
    }


def summarise_log(trial: Trial) -> Summary:
    """Sum up a trial from its log alone, as the run itself did at its end.

    A log without the run's own summary is that of a run that died: outcome ``system_fault``.
    """
    ended: Mapping[str, Any] = trial.summary or {
        "outcome": "system_fault",
        "reason": "the log ends without a summary: the run was killed, or its disk ran full",
    }
    return summarise(
        trial.steps,
        platform=trial.platform,
        policy=trial.policy,
        outcome=ended["outcome"],
        reason=ended.get("reason", ""),
        steps=trial.planned_steps,
        stop_s=ended.get("stop_s"),
        trial=trial.path.parent,
    )


def summarise_boxes(boxes: Sequence[Box | None], path: Path) -> Summary:
    """Sum up a plain file of boxes, which knows neither robot nor time."""
    score = score_boxes(boxes)
    return {
        "platform": None,
        "policy": None,
        "outcome": "lost" if score.lost else "completed",
        "mr": score.mr,
        "mr_visible": score.mr_visible,
        "visibility": score.visibility,
        "el": score.el,
        "ar": None,
        "steps": len(boxes) - 1,
        "trial": str(path),
    }


def summarise_set(summaries: Sequence[Summary]) -> Summary:
    """Put several trials together: `trials`, and `mean` and `std` of mr, el, sr, and of ar if all have it.

    Where there are several platforms or policies, `groups` gives each its own `mean` and `std`. SR is the
    share of trials that were completed. The std is the sample's (ddof = 1); one trial has None.

    Raises:
        ValueError: there are none.
    """
    groups = _by_method(summaries)
    table: Summary = {"trials": list(summaries), **_averages(summaries)}
    if len(groups) > 1:
        table["groups"] = [
            {"platform": platform, "policy": policy, **_averages(group)}
            for (platform, policy), group in groups.items()
        ]
    return table


def summary_table(summaries: Sequence[Summary]) -> RenderableType:
    """Draw a row for each trial and, below, the rows of the paper's real-world table: MR, EL, SR."""
    trials = Table(box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0))
    for column in ("#", "outcome", "MR", "MR seen", "seen", "EL", "AR", "Hz", "p99 ms", "missed"):
        trials.add_column(column, justify="left" if column == "outcome" else "right", no_wrap=True)
    for number, row in enumerate(summaries, start=1):
        trials.add_row(
            str(number),
            row["outcome"],
            _number(row["mr"], 2),
            _number(row["mr_visible"], 2),
            f"{row['visibility']:.0%}",
            f"{row['el']}/{row['steps']}",
            _number(row["ar"], 0),
            _number(row.get("rate_hz"), 1),
            _number(row.get("latency_ms", {}).get("p99"), 1),
            _number(row.get("missed_deadlines"), 0),
        )
    paper = Table(box=box.SIMPLE_HEAD, caption="mean ± std over trials", caption_justify="left")
    for column in ("platform", "policy", "trials", "MR", "EL", "SR"):
        paper.add_column(column, justify="left" if column in ("platform", "policy") else "right")
    for (platform, policy), group in _by_method(summaries).items():
        columns = {key: mean_std(values) for key, values in _columns(group).items()}
        paper.add_row(
            platform or "-",
            policy or "-",
            str(len(group)),
            _plus_minus(columns["mr"], 2),
            _plus_minus(columns["el"], 0),
            _number(columns["sr"][0], 2),
        )
    logs = [Text(f"  {number:3d}  {row['trial']}") for number, row in enumerate(summaries, start=1)]
    return Group(trials, *logs, paper)


def _timing(records: Sequence[StepRecord]) -> Summary:
    """Rate over the whole trial, and sensor-to-command latency; None where there is nothing to time."""
    if not records:
        return {"rate_hz": None, "seconds": 0.0, "latency_ms": _percentiles([]), "missed_deadlines": 0}
    first, last = records[0], records[-1]
    seconds = (last.t_ns - first.t_ns) / 1e9
    return {
        "rate_hz": (last.step - first.step) / seconds if seconds > 0 else None,
        "seconds": seconds,
        "latency_ms": _percentiles([record.latency.sensor_to_command_ms for record in records]),
        "missed_deadlines": last.missed_deadlines,
    }


def _percentiles(values_ms: Sequence[float]) -> dict[str, float | None]:
    if not values_ms:
        return {"p50": None, "p99": None, "max": None}
    p50, p99, highest = np.percentile(values_ms, (50, 99, 100))
    return {"p50": float(p50), "p99": float(p99), "max": float(highest)}


def _averages(summaries: Sequence[Summary]) -> Summary:
    averaged = {key: mean_std(values) for key, values in _columns(summaries).items()}
    return {
        "mean": {key: mean for key, (mean, _) in averaged.items()},
        "std": {key: std for key, (_, std) in averaged.items()},
    }


def _columns(summaries: Sequence[Summary]) -> dict[str, list[float]]:
    columns: dict[str, list[float]] = {
        "mr": [row["mr"] for row in summaries],
        "el": [row["el"] for row in summaries],
        "sr": [float(row["outcome"] == "completed") for row in summaries],
    }
    if all(row["ar"] is not None for row in summaries):
        columns["ar"] = [row["ar"] for row in summaries]
    return columns


def _by_method(summaries: Iterable[Summary]) -> dict[tuple[str | None, str | None], list[Summary]]:
    groups: dict[tuple[str | None, str | None], list[Summary]] = {}
    for row in summaries:
        groups.setdefault((row["platform"], row["policy"]), []).append(row)
    return groups


def _number(value: float | None, digits: int) -> str:
    return "-" if value is None else f"{value:.{digits}f}"


def _plus_minus(mean_and_std: tuple[float, float | None], digits: int) -> str:
    mean, std = mean_and_std
    return _number(mean, digits) if std is None else f"{mean:.{digits}f} ± {std:.{digits}f}"
