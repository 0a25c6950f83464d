"""A comparison as JSON and in a terminal. Keys are a contract: more may be added, none is renamed."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rich.console import Group
from rich.text import Text

from adatracker_deploy.scoring.compare import DIGITS
from adatracker_deploy.scoring.fitting import FittingTable
from adatracker_deploy.scoring.summary import columns_of, counted, statistics_of, summarise_set
from adatracker_deploy.scoring.summary_table import bounds_text, ending_text, number_text

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rich.console import RenderableType

    from adatracker_deploy.scoring.compare import Comparison, Difference
    from adatracker_deploy.scoring.tally import Summary


def comparison_record(
    found: Comparison, ours: Sequence[Summary], theirs: Sequence[Summary]
) -> dict[str, object]:
    """Return both sets as `score` gives them, and the differences, B less A, by metric."""
    return {
        "a": summarise_set(ours),
        "b": summarise_set(theirs),
        "paired": found.paired,
        "differences": {each.metric: _record(each) for each in found.differences},
        "notes": list(found.notes),
    }


def comparison_table(found: Comparison, ours: Sequence[Summary], theirs: Sequence[Summary]) -> RenderableType:
    """Draw means and differences, every trial's own value below, then the words and what to know first."""
    sides = (("A", ours), ("B", theirs))
    rows: list[Sequence[str]] = []
    for each in found.differences:
        digits = 1 if each.unit == "s" else DIGITS[each.metric]
        rows.append(
            (
                f"{each.metric.upper()}{f' ({each.unit})' if each.unit else ''}",
                *(number_text(mean, digits) for mean in each.means),
                f"{each.estimate.value:+z.{digits}f}",
                bounds_text(each.estimate.bounds, digits),
                f"{each.test.p:.2g}",
            )
        )
    table = FittingTable(
        names=(
            "",
            f"A (n = {len(counted(ours))})",
            f"B (n = {len(counted(theirs))})",
            "B less A",
            "95 %",
            "p",
        ),
        rows=rows,
        expendable=("95 %", "p"),
        left=("",),
        bold=[each.test.separates for each in found.differences],
    )
    endings = [Text(f"  {name}: {ending_text(statistics_of(rows), len(rows))}") for name, rows in sides]
    points = [
        Text(f"  {metric.upper()} of {name}: {_points(rows, metric)}")
        for metric in ("mr", "el")
        for name, rows in sides
    ]
    how = "compared pair by pair" if found.paired else "compared as two independent sets"
    words = [Text(f"  {each.words}") for each in found.differences]
    notes = [Text(f"  note: {note}") for note in found.notes]
    return Group(table, *endings, *points, Text(f"\n  {how}:"), *words, *notes)


def _points(rows: Sequence[Summary], metric: str) -> str:
    return ", ".join(number_text(value, DIGITS[metric]) for value in columns_of(counted(rows))[metric])


def _record(each: Difference) -> dict[str, object]:
    return {
        "unit": each.unit,
        "mean": {"a": each.means[0], "b": each.means[1]},
        "difference": each.estimate.value,
        "interval": each.estimate.bounds,
        "p": each.test.p,
        "least_p": each.test.least,
        "exact": each.test.exact,
        "test": each.method,
        "words": each.words,
    }
