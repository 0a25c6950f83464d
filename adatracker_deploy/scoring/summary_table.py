"""Scores in a terminal: a row for each trial, then those of the paper's real-world table, with intervals."""

from __future__ import annotations

import statistics
from typing import TYPE_CHECKING, Any

from rich import box
from rich.console import Group
from rich.table import Column, Table
from rich.text import Text

from adatracker_deploy.core.sight import Verdict
from adatracker_deploy.scoring.fitting import FittingTable
from adatracker_deploy.scoring.stages import FAR_STAGES, STAGES
from adatracker_deploy.scoring.summary import by_method, statistics_of

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rich.console import RenderableType

    from adatracker_deploy.scoring.stages import Percentiles
    from adatracker_deploy.scoring.tally import Summary


def stage_table(summaries: Sequence[Summary]) -> Table:
    """Draw a row for each stage.

    Several trials are shown by the median of their medians, and by the worst of their p99 and maxima.
    """
    name = "what, in ms" if len(summaries) == 1 else f"what, in ms; the worst of {len(summaries)} trials"
    table = Table("stage", Column(name, overflow="fold"), box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0))
    for column in ("p50", "p99", "max"):
        table.add_column(column, justify="right")
    for stage, words in STAGES.items():
        _add(table, stage.replace("_", " "), words, [row["stages_ms"][stage] for row in summaries])
    far = [row["far_ms"] for row in summaries if row["far_ms"]["round_trip"]["p50"] is not None]
    for stage, words in FAR_STAGES.items() if far else ():
        _add(table, stage.replace("_", " "), words, [found[stage] for found in far])
    _add(table, "sensor to command", "from capture to the link", [row["latency_ms"] for row in summaries])
    _add(table, "lateness", "of the loop's ticks", [row["lateness_ms"] for row in summaries])
    return table


def _add(table: Table, name: str, words: str, found: Sequence[Percentiles]) -> None:
    shown = []
    for key, together in (("p50", statistics.median), ("p99", max), ("max", max)):
        values = [value for one in found if (value := one[key]) is not None]
        shown.append(number_text(together(values), 1) if values else "-")
    table.add_row(name, words, *shown)


def summary_table(summaries: Sequence[Summary]) -> RenderableType:
    """Draw a row for each trial and, below, the rows of the paper's real-world table: MR, EL, SR.

    Under each of those stand the 95 % intervals, how the trials ended, and how EL falls off.
    """
    trials = FittingTable(
        names=("#", "outcome", "MR", "MR seen", "seen", "stale", "EL", "s", "AR", "Hz", "p99 ms", "missed"),
        rows=[_cells(number, row) for number, row in enumerate(summaries, start=1)],
        expendable=("s", "AR", "MR seen", "p99 ms", "Hz", "missed", "stale", "seen"),
        left=("outcome",),
    )
    endings, methods = [], by_method(summaries)
    paper: list[Sequence[str]] = []
    for (platform, policy), group in methods.items():
        found = statistics_of(group)
        mean, std, interval = found["mean"], found["std"], found["interval"]
        paper += [
            (
                platform or "-",
                policy or "-",
                str(len(group) - found["left_out"]),
                plus_minus(mean["mr"], std["mr"], 2),
                plus_minus(mean["el"], std["el"], 0),
                number_text(mean["sr"], 2),
            ),
            (
                *("", "", ""),
                *(bounds_text(interval[key], 0 if key == "el" else 2) for key in ("mr", "el", "sr")),
            ),
        ]
        name = f"{platform or '-'}, {policy or '-'}: " if len(methods) > 1 else ""
        endings.append(Text(f"  {name}{ending_text(found, len(group))}"))
        if found["takeovers"] and found["takeovers"]["count"]:
            endings.append(Text(f"  {name}{takeover_text(found['takeovers'])}"))
    logs = [Text(f"  {number:3d}  {row['trial']}") for number, row in enumerate(summaries, start=1)]
    means = FittingTable(
        names=("platform", "policy", "trials", "MR", "EL", "SR"),
        rows=paper,
        expendable=("trials",),
        left=("platform", "policy"),
    )
    key = Text("  mean ± std over trials; in brackets 95 % intervals: Student's t, for SR Wilson's")
    eyes = [
        Text(f"  {number:3d}  eyes: {sight_text(row['sight'])}")
        for number, row in enumerate(summaries, start=1)
        if row.get("sight")
    ]
    return Group(trials, *logs, *eyes, means, key, *endings)


def _cells(number: int, row: Summary) -> tuple[str, ...]:
    return (
        str(number),
        row["outcome"] if row.get("timing_kept", True) else f"{row['outcome']}, late",
        number_text(row["mr"], 2),
        number_text(row["mr_visible"], 2),
        f"{row['visibility']:.0%}",
        f"{row.get('stale', 0.0):.0%}",
        f"{row['el']}/{row['steps']}",
        number_text(row.get("seconds"), 1),
        number_text(row["ar"], 0),
        number_text(row.get("rate_hz"), 1),
        number_text(row.get("latency_ms", {}).get("p99"), 1),
        number_text(row.get("missed_deadlines"), 0),
    )


def ending_text(statistics: Summary, count: int) -> str:
    """Say how trials ended, and how many reached the horizon, where EL is cut off."""
    ends = ", ".join(f"{number} {outcome}" for outcome, number in statistics["outcomes"].items())
    falls = [f"{fall['survival']:.2f} from {fall['el']}" for fall in statistics["survival"]]
    survival = f"; survival 1.00, {', '.join(falls)}" if falls else ""
    left_out = statistics["left_out"]
    late = f"; {left_out} left out, whose timing was not kept" if left_out else ""
    if count == left_out:
        return f"no trial kept its timing: there are no means{late}"
    return f"{ends}; {statistics['censored']} of {count - left_out} at the horizon{survival}{late}"


def takeover_text(takeovers: dict[str, Any]) -> str:
    """Say how often somebody took over, and how far and long the policy drove for each."""
    count, by_hand = takeovers["count"], takeovers["by_hand"]
    between = [f"{takeovers['between_s']:.1f} s"] if count else []
    between += [f"{takeovers['between_m']:.1f} m"] if takeovers["between_m"] is not None else []
    driven = [f"{takeovers['policy_s']:.1f} s"]
    driven += [f"{takeovers['policy_m']:.1f} m"] if takeovers["policy_m"] is not None else []
    per = f", one per {' and '.join(between)} of the policy's driving" if between else ""
    hand = f"; by hand {takeovers['hand_s']:.1f} s" if takeovers["hand_s"] else ""
    times = f"{count} takeover{'' if count == 1 else 's'} ({by_hand} by hand)"
    return f"{times} in {' and '.join(driven)}{per}{hand}"


def sight_text(sight: dict[str, Any]) -> str:
    """Say what a trial's eyes were worth by the truth; `sight` is `SightTally.summary`'s."""
    why = [
        f"{verdict.words} {sight[verdict.value]:.1%}"
        for verdict in Verdict
        if verdict is not Verdict.SEEN and sight[verdict.value]
    ]
    again = sight["found_again_s"]
    found = (
        [f"found again after {again['p50']:.1f} s, {again['max']:.1f} s at most"] if again["times"] else []
    )
    seen = "-" if sight["seen"] is None else f"{sight['seen']:.1%}"
    return ", ".join(
        [
            f"target seen in {seen} of where it was",
            *why,
            f"mask IoU {number_text(sight['mask_iou'], 2)}",
            f"box IoU {number_text(sight['box_iou'], 2)}",
            *found,
            f"MR by the truth {number_text(sight['mr_true'], 2)}",
        ]
    )


def number_text(value: float | None, digits: int) -> str:
    """Return a number, or a dash for none."""
    return "-" if value is None else f"{value:z.{digits}f}"


def plus_minus(mean: float | None, std: float | None, digits: int) -> str:
    """Return mean ± std, of a single trial the mean alone."""
    return (
        number_text(mean, digits) if mean is None or std is None else f"{mean:z.{digits}f} ± {std:.{digits}f}"
    )


def bounds_text(bounds: Sequence[float | None], digits: int) -> str:
    """Return an interval in brackets, or nothing where a single trial bounds nothing."""
    low, high = bounds
    return "" if low is None or high is None else f"[{low:z.{digits}f}, {high:z.{digits}f}]"
