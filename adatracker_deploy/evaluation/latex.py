"""The grid's scores as a LaTeX table in the layout of the paper's per-embodiment results."""

from __future__ import annotations

from typing import TYPE_CHECKING

from adatracker_deploy.evaluation.grid import Cell
from adatracker_deploy.evaluation.rows import Row, rows_of, triple_text
from adatracker_deploy.learning.conditions import HEIGHTS_M, TARGET_SPEEDS_M_S
from adatracker_deploy.scoring.latex import escaped

if TYPE_CHECKING:
    from collections.abc import Sequence

    from adatracker_deploy.evaluation.grid import Grid
    from adatracker_deploy.evaluation.scores import PolicyScore


def latex_table(grid: Grid, scores: Sequence[PolicyScore]) -> str:
    """Return a table* environment; it needs the packages booktabs, multirow, diagbox and graphicx."""
    speeds = " & ".join(rf"\textbf{{{speed_m_s} m/s}}" for speed_m_s in TARGET_SPEEDS_M_S)
    corner = r"\textbf{Method} & \diagbox{Camera Height}{Target Speed}"
    caption = (
        f"Per-embodiment results in {escaped(grid.scene)}, condition {escaped(grid.condition)}: "
        f"AR/EL/SR over {grid.episodes} episodes of {grid.steps} steps a cell."
    )
    bodies = "\n\\midrule\n".join(_body(row) for row in rows_of(grid, scores))
    return "\n".join(
        (
            r"\begin{table*}[htb]",
            r"\centering",
            rf"\caption{{{caption}}}",
            r"\resizebox{\linewidth}{!}{%",
            r"\begin{tabular}{l" + "c" * (1 + len(TARGET_SPEEDS_M_S)) + "|c}",
            r"\toprule",
            rf"{corner} & {speeds} & \textbf{{Mean $\pm$ std}} \\",
            r"\midrule",
            bodies,
            r"\bottomrule",
            r"\end{tabular}}",
            r"\end{table*}",
            "",
        )
    )


def _body(row: Row) -> str:
    summary = {1: triple_text(row.mean)}
    if row.std is not None:
        ar, el, sr = row.std
        summary[2] = rf"$\pm${ar:.0f}/$\pm${el:.0f}/$\pm${sr:.2f}"
    lines = []
    for number, height_m in enumerate(HEIGHTS_M):
        name = rf"\multirow{{{len(HEIGHTS_M)}}}{{*}}{{{escaped(row.name)}}}" if number == 0 else ""
        cells = (row.cells.get(Cell(height_m, speed_m_s)) for speed_m_s in TARGET_SPEEDS_M_S)
        columns = [triple_text(cell) if cell else "--" for cell in cells]
        lines.append(" & ".join((name, f"{height_m}m", *columns, summary.get(number, ""))) + r" \\")
    return "\n".join(lines)
