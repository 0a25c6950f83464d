"""Appearance of a person: colour histograms of chest, waist and legs.

Three stripes distinguish clothes that a histogram of the whole box mixes up; on street footage, in HSV, they
separated people better than the detector's own features did.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import cv2
import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from adatracker_deploy.perception.roles import Boxes, Picture

Appearance = NDArray[np.float32]
"""Square roots of three histograms, shape (3, 128); each row has length 1."""

_STRIPES = ((0.12, 0.32), (0.32, 0.52), (0.55, 0.90))
"""Top and bottom, in fractions of the box's height: the head and the ground are left out."""
_INSET = 0.25
"""Share of the box's width left out on either side: mostly background."""
_BINS = (8, 4, 4)
"""Number of bins of hue, saturation and value."""
_RANGES = (0, 180, 0, 256, 0, 256)


def appearances(picture: Picture, boxes: Boxes) -> NDArray[np.float32]:
    """Return the appearance of the person in each box, shape (n, 3, 128)."""
    looks = np.empty((len(boxes), len(_STRIPES), int(np.prod(_BINS))), np.float32)
    for look, box in zip(looks, boxes, strict=True):
        look[:] = _stripes(picture, box)
    return looks


def likeness(looks: NDArray[np.float32], other: Appearance) -> NDArray[np.float32]:
    """Return the similarity of each of `looks` (n, 3, 128) to `other`, 0 to 1: mean Bhattacharyya
    coefficient."""
    alike = np.asarray(np.einsum("nsb,sb->n", looks, other) / len(_STRIPES), np.float32)
    return np.minimum(alike, np.float32(1))  # roots are rounded: the same look may come out as a hair more


def mixed(old: Appearance, new: Appearance, share: float) -> Appearance:
    """Blend two appearances, with `share` (0 to 1) of the new one."""
    histograms = (1 - share) * np.square(old) + share * np.square(new)
    return np.sqrt(histograms)


def _stripes(picture: Picture, box: NDArray[np.float32]) -> Appearance:
    height, width = picture.shape[:2]
    left, top, right, bottom = map(float, box)
    inset, tall = _INSET * (right - left), bottom - top
    first = min(max(0, int(left + inset)), width - 1)
    last = min(max(first + 1, round(right - inset)), width)
    look = np.empty((len(_STRIPES), int(np.prod(_BINS))), np.float32)
    for row, (begin, end) in zip(look, _STRIPES, strict=True):
        upper = min(max(0, int(top + begin * tall)), height - 1)
        lower = min(max(upper + 1, int(top + end * tall)), height)
        hsv = cv2.cvtColor(np.ascontiguousarray(picture[upper:lower, first:last]), cv2.COLOR_RGB2HSV)
        counts = cv2.calcHist([hsv], [0, 1, 2], None, list(_BINS), list(_RANGES)).ravel()
        row[:] = np.sqrt(counts / counts.sum())
    return look
