"""Appearance of a person: colour histograms of chest, waist and legs.

Three stripes distinguish clothes that a histogram of the whole box mixes up; on street footage, in HSV, they
separated people better than the detector's own features did. They are stripes of the person, not of the box:
of somebody whom the picture cuts off, the stripes outside it are unknown.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import cv2
import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from adatracker_deploy.perception.roles import Boxes, Picture

Appearance = NDArray[np.float32]
"""Square roots of three histograms, shape (3, 128); each row has length 1, or is 0 where the stripe is out of
the picture."""

_STRIPES = np.array([(0.12, 0.32), (0.32, 0.52), (0.55, 0.90)])
"""Top and bottom, in fractions of the person's height: the head and the ground are left out."""
_INSET = 0.25
"""Share of the box's width left out on either side: mostly background."""
_BINS = (8, 4, 4)
"""Number of bins of hue, saturation and value."""
_RANGES = (0, 180, 0, 256, 0, 256)

_AT_EDGE = 0.012
"""Share of the picture's height from its edge within which a box counts as cut off by it."""
_HEIGHT_OF_WIDTH = 2.6
"""A person's height as a multiple of the box's width, where the picture cuts off one end of them. Of 2.2, 2.6
and 3.0 the best at telling 24 rendered people apart when one view is cut off and the other whole: area under
the ROC curve 0.966, as for two whole views (0.967); 0.923 with stripes of the visible part."""
_ABOVE = 0.3
"""Share of what is missing that is taken to be above the picture, of somebody cut off at both ends."""
_ENOUGH = 0.3
"""Share of a stripe in the picture from which on its colours are the person's."""
UNKNOWN = 0.5
"""Likeness of a stripe that one of two appearances lacks: neither like nor unlike."""


def appearances(picture: Picture, boxes: Boxes) -> NDArray[np.float32]:
    """Return the appearance of the person in each box, shape (n, 3, 128)."""
    looks = np.empty((len(boxes), len(_STRIPES), int(np.prod(_BINS))), np.float32)
    for look, box in zip(looks, boxes, strict=True):
        look[:] = _stripes(picture, box)
    return looks


def stripes_known(look: Appearance) -> int:
    """Return how many of the three stripes of a person an appearance has, 0 to 3."""
    return int(np.count_nonzero(look.any(axis=1)))


def is_cut(look: Appearance) -> bool:
    """Return whether the picture cuts off the person above or below, by the stripes that are out of it."""
    return stripes_known(look) < len(look)


def likeness(looks: NDArray[np.float32], other: Appearance) -> NDArray[np.float32]:
    """Return the similarity of each of `looks` (n, 3, 128) to `other`, 0 to 1: mean Bhattacharyya coefficient
    of the stripes, `UNKNOWN` for one that either lacks."""
    both = (looks != 0).any(axis=2) & (other != 0).any(axis=1)
    alike = np.where(both, np.einsum("nsb,sb->ns", looks, other), UNKNOWN).mean(axis=1)
    # Roots are rounded: the same look may come out as a hair more.
    return np.asarray(np.minimum(alike, 1), np.float32)


def mixed(old: Appearance, new: Appearance, share: float) -> Appearance:
    """Blend two appearances, with `share` (0 to 1) of the new one; a stripe that one lacks is the other's."""
    shares = np.where(old.any(axis=1), np.where(new.any(axis=1), share, 0.0), 1.0)[:, None]
    histograms = (1 - shares) * np.square(old) + shares * np.square(new)
    return np.asarray(np.sqrt(histograms), np.float32)


def _whole(top: float, bottom: float, width: float, rows: int) -> tuple[float, float]:
    """Return where the whole person begins and ends, px, of whom a picture of `rows` may show a part."""
    cut_above, cut_below = top < _AT_EDGE * rows, bottom > (1 - _AT_EDGE) * rows
    missing = max(0.0, _HEIGHT_OF_WIDTH * width - (bottom - top))
    above = missing * (_ABOVE if cut_below else 1.0) if cut_above else 0.0
    below = missing - above if cut_below else 0.0
    return top - above, bottom + below


def _stripes(picture: Picture, box: NDArray[np.float32]) -> Appearance:
    height, width = picture.shape[:2]
    left, top, right, bottom = map(float, box)
    inset = _INSET * (right - left)
    first = min(max(0, int(left + inset)), width - 1)
    last = min(max(first + 1, round(right - inset)), width)
    begin, end = _whole(top, bottom, right - left, height)
    look = np.zeros((len(_STRIPES), int(np.prod(_BINS))), np.float32)
    for row, (upper, lower) in zip(look, begin + _STRIPES * (end - begin), strict=True):
        upper_seen, lower_seen = max(upper, top, 0.0), min(lower, bottom, float(height))
        if lower_seen - upper_seen < _ENOUGH * (lower - upper):
            continue
        first_row = min(int(upper_seen), height - 1)
        last_row = min(max(first_row + 1, int(lower_seen)), height)
        part = np.ascontiguousarray(picture[first_row:last_row, first:last])
        hsv = cv2.cvtColor(part, cv2.COLOR_RGB2HSV)
        counts = cv2.calcHist([hsv], [0, 1, 2], None, list(_BINS), list(_RANGES)).ravel()
        row[:] = np.sqrt(counts / counts.sum())
    return look
