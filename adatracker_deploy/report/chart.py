"""Charts over time, drawn by OpenCV, for film strips and replay plots."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING

import cv2

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy as np
    from numpy.typing import NDArray

    Image = NDArray[np.uint8]
    Colour = tuple[int, int, int]

LEFT_PX = 140
"""Room for the charts' names and scales."""
GAP_PX = 14
"""Between charts, and to their right."""

PAPER = (255, 255, 255)
INK = (40, 44, 52)
GREY = (130, 136, 146)
FAINT = (226, 229, 234)
BLUE = (33, 105, 190)
ORANGE = (225, 110, 25)

NAME_SCALE, NUMBER_SCALE = 0.55, 0.45


class Chart:
    """One chart in a strip of a picture; values beyond its scale are drawn at its edge."""

    def __init__(self, area: Image, duration_s: float, low: float, high: float) -> None:
        """Take a strip; nothing is drawn yet.

        Args:
            area: of the picture, RGB uint8 (H, W, 3), drawn into; `LEFT_PX` of it are for name and scale.
            duration_s: that its width shows, from 0.
            low: the value at its lower edge.
            high: the value at its upper edge; more than `low`.
        """
        self._area = area
        self._duration_s = duration_s or 1.0
        self._low, self._high = low, high

    def at(self, time_s: float, value: float) -> tuple[int, int]:
        """Return the column and row of the strip where a value at a time is."""
        height, width = self._area.shape[0], self._area.shape[1] - LEFT_PX - GAP_PX
        share = (min(max(value, self._low), self._high) - self._low) / (self._high - self._low)
        return LEFT_PX + round(time_s / self._duration_s * width), round((1 - share) * (height - 3)) + 1

    def shade(self, from_s: float, to_s: float, colour: Colour) -> None:
        """Colour a stretch of time; before what else is drawn."""
        self._area[:, self.at(from_s, 0)[0] : self.at(to_s, 0)[0] + 1] = colour

    def frame(self, name: str, line: float, digits: str = "g") -> None:
        """Draw the frame, a grey line at a value, the chart's name, and the ends of its scale."""
        left, right = self.at(0, self._high), self.at(self._duration_s, self._low)
        cv2.line(self._area, self.at(0, line), self.at(self._duration_s, line), GREY, 1)
        cv2.rectangle(self._area, left, right, FAINT, 1)
        height = self._area.shape[0]
        write(self._area, name, (GAP_PX, height // 2 + 4), INK, NAME_SCALE)
        for value, row in ((self._high, 12), (self._low, height - 4)):
            text = format(value, digits)
            (width, _), _ = cv2.getTextSize(text, cv2.FONT_HERSHEY_SIMPLEX, NUMBER_SCALE, 1)
            write(self._area, text, (LEFT_PX - 6 - width, row), GREY, NUMBER_SCALE)

    def curve(self, times_s: Sequence[float], values: Sequence[float | None], colour: Colour) -> None:
        """Draw values over time, with gaps where there are none."""
        points = [
            None if value is None else self.at(time_s, value)
            for time_s, value in zip(times_s, values, strict=True)
        ]
        for start, end in pairwise(points):
            if start is not None and end is not None:
                cv2.line(self._area, start, end, colour, 2, cv2.LINE_AA)


def text_px(text: str, scale: float) -> int:
    """Return the width of a line of text."""
    (width, _), _ = cv2.getTextSize(text, cv2.FONT_HERSHEY_SIMPLEX, scale, 1)
    return int(width)


def write(image: Image, text: str, at: tuple[int, int], colour: Colour, scale: float) -> None:
    """Write a line of ASCII text, its lower left corner `at` a column and row."""
    cv2.putText(image, text, at, cv2.FONT_HERSHEY_SIMPLEX, scale, colour, 1, cv2.LINE_AA)
