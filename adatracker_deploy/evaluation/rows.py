"""A method's row of the paper's table, measured or published, for tables, LaTeX and figures."""

from __future__ import annotations

import math
import statistics
from dataclasses import dataclass
from typing import TYPE_CHECKING

from rich.text import Text

from adatracker_deploy.evaluation.grid import Cell, Grid
from adatracker_deploy.evaluation.published import PUBLISHED, Triple
from adatracker_deploy.evaluation.scores import METRICS, Metrics, PolicyScore

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from adatracker_deploy.scoring.stats.intervals import Estimate


@dataclass(frozen=True, slots=True)
class Row:
    """AR, EL and SR by cell, and overall."""

    name: str
    cells: Mapping[Cell, Triple]
    mean: Triple
    metrics: Mapping[Cell, Metrics]
    """With intervals; empty for what was published, which has none."""
    overall: Metrics | None

    @property
    def std(self) -> Triple | None:
        """Over the cells: the sample's, which is what the paper prints; a single cell has none."""
        if len(self.cells) < 2:
            return None
        ar, el, sr = (statistics.stdev(values) for values in zip(*self.cells.values(), strict=True))
        return ar, el, sr


def rows_of(grid: Grid, scores: Sequence[PolicyScore]) -> list[Row]:
    """Return what was measured, then the paper's figures where they are for the same scene and horizon."""
    rows = [_measured(score) for score in scores]
    if grid.is_the_papers:
        rows += [Row(f"{row.name} (paper)", row.cells, row.mean, {}, None) for row in PUBLISHED]
    return rows


def triple_text(triple: Triple) -> str:
    """Return AR/EL/SR as the paper prints them."""
    ar, el, sr = triple
    return f"{ar:z.0f}/{el:.0f}/{sr:.2f}"


def interval_text(estimate: Estimate, digits: int) -> str:
    """Return the bounds, or nothing where one value bounds nothing."""
    if not math.isfinite(estimate.low):
        return ""
    return f"[{estimate.low:z.{digits}f}, {estimate.high:z.{digits}f}]"


def signed_text(estimate: Estimate, digits: int) -> Text:
    """Return a difference with its interval, bold where zero is excluded."""
    text = f"{estimate.value:+z.{digits}f} {interval_text(estimate, digits)}".rstrip()
    return Text(text, style="bold" if estimate.excludes_zero else "")


def _measured(score: PolicyScore) -> Row:
    metrics = {cell.cell: cell.metrics for cell in score.cells}
    overall = score.metrics
    return Row(
        score.name,
        {cell: _triple(each) for cell, each in metrics.items()},
        _triple(overall),
        metrics,
        overall,
    )


def _triple(metrics: Metrics) -> Triple:
    ar, el, sr = (getattr(metrics, metric).value for metric in METRICS)
    return ar, el, sr
