"""Two courses of a command as one picture: a chart for each axis, the logged one and the replayed one."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import TYPE_CHECKING

import cv2
import numpy as np

from adatracker_deploy.replay.compare import AXES

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from adatracker_deploy.platform import Twist

    Image = NDArray[np.uint8]
    Colour = tuple[int, int, int]

WIDTH_PX = 1200
CHART_PX = 200
LEFT_PX = 130
"""Room for the charts' names and scales."""
GAP_PX = 24

PAPER = (255, 255, 255)
INK = (40, 44, 52)
FAINT = (226, 229, 234)
LOGGED = (33, 105, 190)
REPLAYED = (225, 110, 25)


def command_plot(times_s: Sequence[float], logged: Sequence[Twist], replayed: Sequence[Twist]) -> Image:
    """Draw both courses as an RGB image of shape (H, W, 3), uint8.

    Args:
        times_s: of the ticks, from the first; at least one.
        logged: what was asked for, as many; drawn in blue.
        replayed: what is asked for now, as many; drawn in orange, above.
    """
    used = [axis for axis in AXES if any(getattr(twist, axis) for twist in (*logged, *replayed))] or ["vx"]
    image = np.full((GAP_PX * 2 + len(used) * (CHART_PX + GAP_PX), WIDTH_PX, 3), PAPER, np.uint8)
    _write(image, "logged", (LEFT_PX, 17), LOGGED)
    _write(image, "replayed", (LEFT_PX + 90, 17), REPLAYED)
    _write(image, f"{times_s[-1]:.1f} s", (WIDTH_PX - 80, 17), INK)
    for place, axis in enumerate(used):
        top = GAP_PX + place * (CHART_PX + GAP_PX)
        courses = [[float(getattr(twist, axis)) for twist in course] for course in (logged, replayed)]
        _chart(image[top : top + CHART_PX], f"{axis}, {AXES[axis]}", times_s, courses)
    return image


def _chart(area: Image, name: str, times_s: Sequence[float], courses: Sequence[Sequence[float]]) -> None:
    finite = [value for course in courses for value in course if _drawable(value)]
    low, high = min((0.0, *finite)), max((0.0, *finite))
    height, width = CHART_PX - 1, WIDTH_PX - LEFT_PX - GAP_PX
    span, duration_s = high - low or 1.0, times_s[-1] or 1.0

    def at(time_s: float, value: float) -> tuple[int, int]:
        return LEFT_PX + round(time_s / duration_s * width), round((high - value) / span * height)

    cv2.rectangle(area, at(0, high), at(duration_s, high - span), FAINT, 1)
    cv2.line(area, at(0, 0), at(duration_s, 0), FAINT, 1)
    for course, colour in zip(courses, (LOGGED, REPLAYED), strict=True):
        for (a_s, a), (b_s, b) in pairwise(zip(times_s, course, strict=True)):
            if _drawable(a) and _drawable(b):
                cv2.line(area, at(a_s, a), at(b_s, b), colour, 1, cv2.LINE_AA)
    _write(area, name, (8, CHART_PX // 2), INK)
    _write(area, f"{high:.2f}", (LEFT_PX - 48, 14), INK)
    _write(area, f"{high - span:.2f}", (LEFT_PX - 48, CHART_PX - 4), INK)


def _drawable(value: float) -> bool:
    """Tell whether a velocity is one: damage in a log may be of any size."""
    return math.isfinite(value) and abs(value) < 1e6


def _write(image: Image, text: str, at: tuple[int, int], colour: Colour) -> None:
    cv2.putText(image, text, at, cv2.FONT_HERSHEY_SIMPLEX, 0.45, colour, 1, cv2.LINE_AA)
