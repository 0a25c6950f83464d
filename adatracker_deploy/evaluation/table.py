"""The grid's scores in a terminal, laid out as in the paper: one row per height, one column per target
speed."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from rich.console import Group
from rich.table import Table
from rich.text import Text

from adatracker_deploy.evaluation.grid import CELLS, Cell
from adatracker_deploy.evaluation.rows import Row, interval_text, rows_of, signed_text, triple_text
from adatracker_deploy.learning.conditions import HEIGHTS_M, TARGET_SPEEDS_M_S
from adatracker_deploy.perception.segmenters import TRUTH

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rich.console import RenderableType

    from adatracker_deploy.evaluation.eyes import Sights
    from adatracker_deploy.evaluation.grid import Grid
    from adatracker_deploy.evaluation.scores import Difference, PolicyScore


def grid_table(
    grid: Grid, scores: Sequence[PolicyScore], differences: Sequence[Difference]
) -> RenderableType:
    """Draw AR/EL/SR by cell and overall, and differences between policies, with 95 % intervals."""
    played = sum(len(cell.episodes) for score in scores for cell in score.cells)
    asked = grid.episodes * len(CELLS) * len(grid.policies)
    part = "" if played == asked else f" ({played} of {asked} episodes)"
    eyes = "" if grid.segmenter == TRUTH else f", seen by {grid.segmenter}"
    if grid.aspect is not None:
        eyes += f", pictures {grid.aspect:g} as high as wide"
    title = (
        f"{grid.condition}, {grid.scene}{eyes}: AR/EL/SR, {grid.episodes} x {grid.steps} steps a cell{part}"
    )
    parts: list[RenderableType] = [Text(title, style="italic")]
    for row in rows_of(grid, scores):
        parts += [_heading(row), _cells(row)]
    floored = "  ".join(f"{score.name} {score.floored_ar:z.0f}" for score in scores)
    parts.append(Text(f"\nAR with the published simulator's floor of -1 a step: {floored}"))
    parts += [_sights(score.name, sights) for score in scores if (sights := score.sights)]
    if differences:
        parts += [
            Text("paired differences on equal episodes; bold: zero is excluded"),
            _table_of(differences),
        ]
    return Group(*parts)


def _sights(name: str, sights: Sights) -> Text:
    return Text(
        f"{name} saw the target in {sights.seen:.1%} of the pictures that show it, mask IoU "
        f"{sights.mask_iou:.2f}, and somebody else in {sights.wrong:.2%} of all"
    )


def _heading(row: Row) -> Text:
    text = Text(f"\n{row.name}  ", style="bold" if row.overall else "dim")
    text.append(triple_text(row.mean))
    if row.overall is not None:
        intervals = ((row.overall.ar, 0), (row.overall.el, 0), (row.overall.sr, 2))
        bounds = "  ".join(interval_text(estimate, digits) for estimate, digits in intervals)
        text.append(f"  95 %: {bounds}", style="not bold")
    return text


def _cells(row: Row) -> Table:
    table = Table(box=None, padding=(0, 1, 0, 0), header_style="italic", style="" if row.overall else "dim")
    table.add_column("camera", justify="right", no_wrap=True)
    for speed_m_s in TARGET_SPEEDS_M_S:
        table.add_column(f"{speed_m_s:g} m/s", justify="right", no_wrap=True, min_width=17)
    for height_m in HEIGHTS_M:
        cells = (Cell(height_m, speed_m_s) for speed_m_s in TARGET_SPEEDS_M_S)
        table.add_row(f"{height_m:g} m", *(_cell(row, cell) for cell in cells), style=table.style)
    return table


def _cell(row: Row, cell: Cell) -> str:
    """Draw AR/EL/SR with half the width of AR's interval."""
    if cell not in row.cells:
        return "-"
    text = triple_text(row.cells[cell])
    if cell not in row.metrics or not math.isfinite(row.metrics[cell].ar.high):
        return text
    ar, rest = text.split("/", maxsplit=1)
    estimate = row.metrics[cell].ar
    return f"{ar}±{estimate.high - estimate.value:.0f}/{rest}"


def _table_of(differences: Sequence[Difference]) -> Table:
    table = Table(box=None, padding=(0, 1, 0, 0), header_style="italic")
    for column in ("policy", "less", "episodes", "AR", "EL", "SR"):
        is_name = column in ("policy", "less")
        table.add_column(column, justify="left" if is_name else "right", no_wrap=not is_name)
    for each in differences:
        table.add_row(
            each.policy,
            each.baseline,
            str(each.episodes),
            signed_text(each.metrics.ar, 0),
            signed_text(each.metrics.el, 0),
            signed_text(each.metrics.sr, 2),
        )
    return table
