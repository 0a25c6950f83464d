"""The grid's scores as heat maps, one panel per policy (needs matplotlib, from the train extra)."""

from __future__ import annotations

import importlib.util
from typing import TYPE_CHECKING

import numpy as np

from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.evaluation.grid import Cell
from adatracker_deploy.evaluation.rows import Row, rows_of, triple_text
from adatracker_deploy.learning.conditions import HEIGHTS_M, TARGET_SPEEDS_M_S

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.image import AxesImage

    from adatracker_deploy.evaluation.grid import Grid
    from adatracker_deploy.evaluation.scores import PolicyScore


def check_drawing(path: Path) -> None:
    """Tell now, before hours of work, whether a picture can be written there.

    Raises:
        UsageError: matplotlib is not installed, the folder is not there, or the ending is not .png.
    """
    if importlib.util.find_spec("matplotlib") is None:
        raise UsageError("pictures need matplotlib: pip install 'adatracker-deploy[train]'")
    if path.suffix != ".png":
        raise UsageError(f"{path}: name a picture that ends in .png")
    if not path.parent.is_dir():
        raise UsageError(f"{path}: there is no folder {path.parent}")


def write_figure(figure: Figure, path: Path) -> None:
    """Write a PNG.

    Raises:
        UsageError: it cannot be written.
    """
    try:
        figure.savefig(path, format="png")
    except OSError as error:
        raise UsageError(f"{path}: cannot be written ({error.strerror})") from error


_PANELS_A_ROW = 3
_COLOURS = "YlGnBu"
_DARK = 0.55
"""From this share of the scale on, text is white."""


def grid_picture(grid: Grid, scores: Sequence[PolicyScore]) -> Figure:
    """Draw AR as colour and AR/EL/SR as text, by camera height and target's speed; the paper's beside."""
    from matplotlib.figure import Figure

    rows = rows_of(grid, scores)
    columns = min(len(rows), _PANELS_A_ROW)
    lines = -(-len(rows) // columns)
    figure = Figure(figsize=(4.0 * columns + 0.8, 3.1 * lines + 0.7), layout="constrained", dpi=150)
    panels = figure.subplots(lines, columns, squeeze=False).ravel()
    for panel, row in zip(panels, rows, strict=False):
        image = _panel(panel, row, grid.steps)
    for unused in panels[len(rows) :]:
        unused.set_axis_off()
    bar = figure.colorbar(image, ax=panels.tolist(), shrink=0.6, aspect=30, extend="min")
    bar.set_label("accumulated reward")
    figure.suptitle(f"{grid.condition}, {grid.scene}: AR/EL/SR, {grid.episodes} episodes a cell")
    return figure


def _panel(axes: Axes, row: Row, steps: int) -> AxesImage:
    ar = np.full((len(HEIGHTS_M), len(TARGET_SPEEDS_M_S)), np.nan)
    for line, height_m in enumerate(HEIGHTS_M):
        for column, speed_m_s in enumerate(TARGET_SPEEDS_M_S):
            triple = row.cells.get(Cell(height_m, speed_m_s))
            if triple is not None:
                ar[line, column] = triple[0]
                colour = "white" if triple[0] > _DARK * steps else "black"
                number, rest = triple_text(triple).split("/", maxsplit=1)
                axes.text(column, line + 0.1, number, ha="center", va="center", size=12, color=colour)
                axes.text(column, line - 0.22, rest, ha="center", va="center", size=7, color=colour)
    image = axes.imshow(ar, cmap=_COLOURS, vmin=0, vmax=steps, origin="lower", aspect="auto")
    axes.set_xticks(range(len(TARGET_SPEEDS_M_S)), [f"{speed:g}" for speed in TARGET_SPEEDS_M_S])
    axes.set_yticks(range(len(HEIGHTS_M)), [f"{height:g}" for height in HEIGHTS_M])
    axes.set_xlabel("target's speed, m/s")
    axes.set_ylabel("camera height, m")
    axes.set_title(f"{row.name}: {triple_text(row.mean)}", size=10)
    axes.tick_params(length=0)
    axes.spines[:].set_visible(False)
    return image
