"""Plots logged and replayed commands, one chart per axis."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from adatracker_deploy.replay.compare import AXES
from adatracker_deploy.report.chart import BLUE, GAP_PX, INK, LEFT_PX, NAME_SCALE, ORANGE, PAPER, Chart, write

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from adatracker_deploy.core.messages import Twist

WIDTH_PX = 1200
CHART_PX = 200
HEAD_PX = 28
LOGGED, REPLAYED = BLUE, ORANGE


def command_plot(
    times_s: Sequence[float], logged: Sequence[Twist], replayed: Sequence[Twist]
) -> NDArray[np.uint8]:
    """Draw both courses as an RGB image of shape (H, W, 3), uint8.

    Args:
        times_s: of the ticks, from the first; at least one.
        logged: the logged commands, as many; drawn in blue.
        replayed: the new commands, as many; drawn in orange, above.
    """
    used = [axis for axis in AXES if any(getattr(twist, axis) for twist in (*logged, *replayed))] or ["vx"]
    image = np.full((HEAD_PX + len(used) * (CHART_PX + GAP_PX), WIDTH_PX, 3), PAPER, np.uint8)
    write(image, "logged", (LEFT_PX, 18), LOGGED, NAME_SCALE)
    write(image, "replayed", (LEFT_PX + 90, 18), REPLAYED, NAME_SCALE)
    write(image, f"{times_s[-1]:.1f} s", (WIDTH_PX - 80, 18), INK, NAME_SCALE)
    for place, axis in enumerate(used):
        top = HEAD_PX + place * (CHART_PX + GAP_PX)
        courses = [[_drawable(getattr(twist, axis)) for twist in course] for course in (logged, replayed)]
        known = [0.0, *(value for course in courses for value in course if value is not None)]
        low, high = min(known), max(known)
        high = high if high > low else low + 1.0
        chart = Chart(image[top : top + CHART_PX], times_s[-1], low, high)
        chart.frame(f"{axis}, {AXES[axis]}", line=0.0, digits=".2f")
        for course, colour in zip(courses, (LOGGED, REPLAYED), strict=True):
            chart.curve(times_s, course, colour)
    return image


def _drawable(value: float) -> float | None:
    """Return a velocity; None for an invalid one: damage in a log may be of any size."""
    return float(value) if math.isfinite(value) and abs(value) < 1e6 else None
