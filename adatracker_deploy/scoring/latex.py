"""Trials as a LaTeX table, laid out as the paper's real-world comparison: platforms, methods, MR, EL, SR."""

from __future__ import annotations

from typing import TYPE_CHECKING

from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.scoring.summary import by_method, counted, statistics_of

if TYPE_CHECKING:
    from collections.abc import Sequence

    from adatracker_deploy.scoring.tally import Summary

_SPECIAL = str.maketrans(
    {
        **{character: f"\\{character}" for character in "&%$#_{}"},
        "~": r"\textasciitilde{}",
        "^": r"\textasciicircum{}",
        "\\": r"\textbackslash{}",
    }
)


def escaped(text: str) -> str:
    """Return text as LaTeX prints it."""
    return text.translate(_SPECIAL)


def real_world_table(summaries: Sequence[Summary]) -> str:
    """Return a table environment; it needs the packages booktabs and graphicx.

    Platforms and, within each, policies come in the order of their first trials. EL is marked where trials
    reached the horizon, and the caption says what that means and gives the numbers of trials. Those
    that are not `counted` are left out.

    Raises:
        UsageError: none is left.
    """
    summaries = counted(summaries)
    if not summaries:
        raise UsageError("no trial kept its timing, so there is no table to write; --all counts them all")
    platforms: dict[str, list[str]] = {}
    groups = by_method(summaries)
    for (platform, policy), group in groups.items():
        rows = platforms.setdefault(platform or "--", [])
        name = "" if rows else escaped(platform or "--")
        rows.append(f"{name} & {escaped(policy or '--')} & {_cells(group)} \\\\")
    counts = sorted({len(group) for group in groups.values()})
    trials = f"{counts[0]}" if len(counts) == 1 else f"{counts[0]} to {counts[-1]}"
    caption = (
        f"Mean $\\pm$ std (sample) over {trials} trials each, in brackets 95\\,\\% intervals: Student's $t$, "
        "for SR Wilson's. $^\\dagger$ Some trials reached the horizon, so EL is a lower bound."
    )
    return "\n".join(
        (
            r"\begin{table}[tb]",
            rf"\caption{{{caption}}}",
            r"\centering",
            r"\resizebox{\columnwidth}{!}{%",
            r"\begin{tabular}{l|cccc}",
            r"\toprule",
            r"\textbf{Platform} & \textbf{Method} & \textbf{MR} & \textbf{EL} & \textbf{SR} \\ \midrule",
            "\n\\hline\n".join("\n".join(rows) for rows in platforms.values()),
            r"\bottomrule",
            r"\end{tabular}%",
            r"}",
            r"\end{table}",
            "",
        )
    )


def _cells(group: Sequence[Summary]) -> str:
    found = statistics_of(group)
    mark = r"$^\dagger$" if found["censored"] else ""
    return " & ".join(
        (
            _cell(found, "mr", 2),
            _cell(found, "el", 0) + mark,
            f"{found['mean']['sr']:.2f}{_bounds(found, 'sr', 2)}",
        )
    )


def _cell(found: Summary, metric: str, digits: int) -> str:
    mean, std = found["mean"][metric], found["std"][metric]
    spread = "" if std is None else rf" $\pm$ {std:.{digits}f}"
    return f"{mean:.{digits}f}{spread}{_bounds(found, metric, digits)}"


def _bounds(found: Summary, metric: str, digits: int) -> str:
    low, high = found["interval"][metric]
    return "" if low is None or high is None else f" [{low:z.{digits}f}, {high:z.{digits}f}]"
