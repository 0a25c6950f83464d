"""Estimates camera motion between two images: the image displacement of a standing person."""

from __future__ import annotations

from typing import TYPE_CHECKING

import cv2
import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from adatracker_deploy.perception.roles import Boxes, Picture

Motion = NDArray[np.float64]
"""Shape (2, 3): takes a point (x, y, 1) of the last picture to this one, px; a shift, a turn and a scale."""

STILL: Motion = np.eye(2, 3)

_SMALL_PX = 240
"""Width at which motion is looked for, about."""
_CORNERS = 80
_FEWEST = 12
"""Corners that must agree, for a motion to be believed."""
_LARGEST_SCALE, _LARGEST_SHIFT = 1.25, 0.35
"""From one picture to the next; the shift in fractions of the width. More is a mistake, or a cut."""


class CameraMotion:
    """Compares each picture with the one before by corners outside of people.

    Corners by Shi and Tomasi (1994), followed by Lucas and Kanade (1981), both as OpenCV has them.
    """

    def __init__(self) -> None:
        self._last: NDArray[np.uint8] | None = None
        self._corners: NDArray[np.float32] | None = None

    def __call__(self, picture: Picture, people: Boxes) -> Motion:
        """Return the motion since the last picture; `STILL` for the first, and where it is unknown.

        Args:
            picture: RGB of shape (H, W, 3); all of one size.
            people: boxes in it, which may move by themselves.
        """
        grey, scale = _small(picture)
        last, corners = self._last, self._corners
        background = np.full(grey.shape, 255, np.uint8)
        for left, top, right, bottom in (people * scale).astype(int):
            background[max(0, top) : bottom + 1, max(0, left) : right + 1] = 0
        self._last = grey
        self._corners = cv2.goodFeaturesToTrack(grey, _CORNERS, 0.01, 8, mask=background)
        if last is None or corners is None or len(corners) < _FEWEST or last.shape != grey.shape:
            return STILL
        there, found, _ = cv2.calcOpticalFlowPyrLK(last, grey, corners, None)
        seen = found.ravel() == 1
        if seen.sum() < _FEWEST:
            return STILL
        motion, agreed = cv2.estimateAffinePartial2D(corners[seen], there[seen], ransacReprojThreshold=2.0)
        if motion is None or agreed.sum() < max(_FEWEST, 0.4 * seen.sum()):
            return STILL
        zoom = float(np.hypot(motion[0, 0], motion[1, 0]))
        if (
            not 1 / _LARGEST_SCALE < zoom < _LARGEST_SCALE
            or np.abs(motion[:, 2]).max() > _LARGEST_SHIFT * grey.shape[1]
        ):
            return STILL
        motion[:, 2] /= scale
        return np.asarray(motion, np.float64)


def _small(picture: Picture) -> tuple[NDArray[np.uint8], float]:
    """Return the picture in grey, reduced by a whole number (which is fast), and by how much."""
    height, width = picture.shape[:2]
    grey = cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY)
    by = max(1, round(width / _SMALL_PX))
    if by == 1:
        return np.asarray(grey, np.uint8), 1.0
    size = width // by, max(1, height // by)
    whole = grey[: size[1] * by, : size[0] * by]
    return np.asarray(cv2.resize(whole, size, interpolation=cv2.INTER_AREA), np.uint8), 1 / by
