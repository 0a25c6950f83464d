"""Scores in a terminal: a row for each trial, then those of the paper's real-world table, with intervals."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rich import box
from rich.console import Group
from rich.table import Table
from rich.text import Text

from adatracker_deploy.trial.summary import by_method, statistics_of

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rich.console import RenderableType

    from adatracker_deploy.trial.tally import Summary


def summary_table(summaries: Sequence[Summary]) -> RenderableType:
    """Draw a row for each trial and, below, the rows of the paper's real-world table: MR, EL, SR.

    Under each of those stand the 95 % intervals, how the trials ended, and how EL falls off.
    """
    trials = Table(box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0))
    for column in ("#", "outcome", "MR", "MR seen", "seen", "EL", "s", "AR", "Hz", "p99 ms", "missed"):
        trials.add_column(column, justify="left" if column == "outcome" else "right", no_wrap=True)
    for number, row in enumerate(summaries, start=1):
        trials.add_row(
            str(number),
            row["outcome"],
            number_text(row["mr"], 2),
            number_text(row["mr_visible"], 2),
            f"{row['visibility']:.0%}",
            f"{row['el']}/{row['steps']}",
            number_text(row.get("seconds"), 1),
            number_text(row["ar"], 0),
            number_text(row.get("rate_hz"), 1),
            number_text(row.get("latency_ms", {}).get("p99"), 1),
            number_text(row.get("missed_deadlines"), 0),
        )
    paper = Table(
        box=box.SIMPLE_HEAD,
        caption="mean ± std over trials; in brackets 95 % intervals: Student's t, for SR Wilson's",
        caption_justify="left",
    )
    for column in ("platform", "policy", "trials", "MR", "EL", "SR"):
        paper.add_column(column, justify="left" if column in ("platform", "policy") else "right")
    endings, methods = [], by_method(summaries)
    for (platform, policy), group in methods.items():
        found = statistics_of(group)
        mean, std, interval = found["mean"], found["std"], found["interval"]
        paper.add_row(
            platform or "-",
            policy or "-",
            str(len(group)),
            plus_minus(mean["mr"], std["mr"], 2),
            plus_minus(mean["el"], std["el"], 0),
            number_text(mean["sr"], 2),
        )
        paper.add_row(
            "", "", "", *(bounds_text(interval[key], 0 if key == "el" else 2) for key in ("mr", "el", "sr"))
        )
        name = f"{platform or '-'}, {policy or '-'}: " if len(methods) > 1 else ""
        endings.append(Text(f"  {name}{ending_text(found, len(group))}"))
    logs = [Text(f"  {number:3d}  {row['trial']}") for number, row in enumerate(summaries, start=1)]
    return Group(trials, *logs, paper, *endings)


def ending_text(statistics: Summary, count: int) -> str:
    """Say how trials ended, and how many reached the horizon, where EL is cut off."""
    ends = ", ".join(f"{number} {outcome}" for outcome, number in statistics["outcomes"].items())
    falls = [f"{fall['survival']:.2f} from {fall['el']}" for fall in statistics["survival"]]
    survival = f"; survival 1.00, {', '.join(falls)}" if falls else ""
    return f"{ends}; {statistics['censored']} of {count} at the horizon{survival}"


def number_text(value: float | None, digits: int) -> str:
    """Return a number, or a dash for none."""
    return "-" if value is None else f"{value:z.{digits}f}"


def plus_minus(mean: float, std: float | None, digits: int) -> str:
    """Return mean ± std, of a single trial the mean alone."""
    return number_text(mean, digits) if std is None else f"{mean:z.{digits}f} ± {std:.{digits}f}"


def bounds_text(bounds: Sequence[float | None], digits: int) -> str:
    """Return an interval in brackets, or nothing where a single trial bounds nothing."""
    low, high = bounds
    return "" if low is None or high is None else f"[{low:z.{digits}f}, {high:z.{digits}f}]"
