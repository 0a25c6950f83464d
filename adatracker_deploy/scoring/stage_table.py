"""The latency from sensor to robot by stage, as a table in a terminal."""

from __future__ import annotations

import statistics
from typing import TYPE_CHECKING

from rich import box
from rich.table import Column, Table

from adatracker_deploy.scoring.stages import STAGES
from adatracker_deploy.scoring.summary_table import number_text

if TYPE_CHECKING:
    from collections.abc import Sequence

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
    _add(table, "sensor to command", "from capture to the link", [row["latency_ms"] for row in summaries])
    _add(table, "lateness", "of the loop's ticks", [row["lateness_ms"] for row in summaries])
    return table


def _add(table: Table, name: str, words: str, found: Sequence[Percentiles]) -> None:
    shown = []
    for key, together in (("p50", statistics.median), ("p99", max), ("max", max)):
        values = [value for one in found if (value := one[key]) is not None]
        shown.append(number_text(together(values), 1) if values else "-")
    table.add_row(name, words, *shown)
