"""Shows a context study as a table in a terminal and as a figure (needs matplotlib)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from rich import box
from rich.console import Group
from rich.table import Table

from adatracker_deploy.evaluation.context import SETTLED, plane
from adatracker_deploy.evaluation.rows import interval_text

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from rich.console import RenderableType

    from adatracker_deploy.evaluation.context import Array
    from adatracker_deploy.evaluation.context_study import ContextStudy, Swap


def context_table(name: str, study: ContextStudy) -> RenderableType:
    """Draw R^2 of each truth, how fast z settles, and what a swap costs."""
    known = Table(title=f"{name}: z of {len(study.bodies)} bodies", box=box.SIMPLE_HEAD, title_justify="left")
    known.add_column("explained by a tick's z")
    known.add_column("held-out R²", justify="right")
    for truth, r2 in study.r2.items():
        known.add_row(truth, "-" if r2 is None else f"{r2:.2f}")
    when = "never" if study.settled_tick is None else f"tick {study.settled_tick}"
    settled = f"settled ({SETTLED:.0%} of the cosine to the episode's mean that it ends with): {when}"
    return Group(known, settled, *([_swap_table(study.swap)] if study.swap is not None else []))


def _swap_table(swap: Swap) -> Table:
    table = Table(box=box.SIMPLE_HEAD)
    table.add_column("z")
    table.add_column("AR, 95 %", justify="right")
    table.add_row("the encoder's, every tick", f"{swap.own.value:.0f} {interval_text(swap.own, 0)}")
    for name, change in (("this body's mean", swap.frozen), ("another body's mean", swap.swapped)):
        table.add_row(name, f"{change.value:+z.0f} {interval_text(change, 0)}")
    return table


def context_picture(name: str, study: ContextStudy) -> Figure:
    """Draw every body's z in a plane, coloured by height and by lag, and how z settles."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(13.5, 4.0), layout="constrained", dpi=150)
    by_height, by_lag, over_time = figure.subplots(1, 3)
    points, shares = plane(np.array([body.mean for body in study.bodies]))
    for axes, label, values in (
        (by_height, "camera height, m", [body.embodiment.height_m for body in study.bodies]),
        (by_lag, "lag, s", [body.embodiment.lag_s for body in study.bodies]),
    ):
        _scatter(axes, points, shares, label, values)
    over_time.plot(range(1, len(study.cosines) + 1), study.cosines, color="#2169be", linewidth=1.5)
    if study.settled_tick is not None:
        over_time.axvline(study.settled_tick + 1, color="#c83228", linestyle="--", linewidth=1)
        over_time.text(study.settled_tick + 1, 0.02, f" tick {study.settled_tick}", color="#c83228", size=9)
    over_time.set(xscale="log", ylim=(min(0.0, float(study.cosines.min())), 1.02), xlabel="ticks seen")
    over_time.set_title("cosine of z to the episode's mean", size=10)
    figure.suptitle(f"{name}: the context of {len(study.bodies)} bodies, one episode each")
    return figure


def _scatter(axes: Axes, points: Array, shares: Array, label: str, values: list[float]) -> None:
    dots = axes.scatter(points[:, 0], points[:, 1], c=values, cmap="viridis", s=22, linewidths=0)
    axes.set_xlabel(f"first component, {shares[0]:.0%} of the variance")
    axes.set_ylabel(f"second, {shares[1]:.0%}")
    axes.set_title(f"coloured by {label}", size=10)
    figure = axes.get_figure()
    assert figure is not None
    figure.colorbar(dots, ax=axes)
