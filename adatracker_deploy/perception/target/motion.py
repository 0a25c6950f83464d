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
_COARSE = 3
"""Reduction of the pictures in which the shift is looked for first."""
_DOWN = 0.15
"""Largest shift up and down that is looked for, in fractions of the height: robots turn, they do not nod."""
_LEAST_LIKE = 0.5
"""Correlation from which on such a shift is believed."""


class CameraMotion:
    """Compares each picture with the one before by corners outside of people.

    Corners by Shi and Tomasi (1994), followed by Lucas and Kanade (1981), both as OpenCV has them. They are
    followed over a few pixels only, while a robot that turns at 2 rad/s moves the picture by a sixth of its
    width. So they begin where most of the last picture lies in this one, by normalised cross-correlation.
    """

    def __init__(self) -> None:
        self._last: NDArray[np.uint8] | None = None
        self._background: NDArray[np.uint8] | None = None
        self._corners: NDArray[np.float32] | None = None

    def __call__(self, picture: Picture, people: Boxes) -> Motion:
        """Return the motion since the last picture; `STILL` for the first, and where it is unknown.

        Args:
            picture: RGB of shape (H, W, 3); all of one size.
            people: boxes in it, which may move by themselves.
        """
        grey, scale = _small(picture)
        last, corners, background = self._last, self._corners, self._background
        self._last, self._background = grey, np.full(grey.shape, 255, np.uint8)
        for left, top, right, bottom in (people * scale).astype(int):
            self._background[max(0, top) : bottom + 1, max(0, left) : right + 1] = 0
        self._corners = cv2.goodFeaturesToTrack(grey, _CORNERS, 0.01, 8, mask=self._background)
        if last is None or background is None or last.shape != grey.shape:
            return STILL
        if corners is None or len(corners) < _FEWEST:
            return STILL
        for shift in dict.fromkeys((_shift(last, grey, background), (0.0, 0.0))):
            motion = _followed(last, grey, corners, shift)
            if motion is not None:
                motion[:, 2] /= scale
                return motion
        return STILL


def _followed(
    last: NDArray[np.uint8], grey: NDArray[np.uint8], corners: NDArray[np.float32], shift: tuple[float, float]
) -> Motion | None:
    """Return the motion that most corners agree on, looked for from `shift`; None if there is none."""
    begun = corners + np.array(shift, np.float32)
    there, found, _ = cv2.calcOpticalFlowPyrLK(last, grey, corners, begun, flags=cv2.OPTFLOW_USE_INITIAL_FLOW)
    seen = found.ravel() == 1
    if seen.sum() < _FEWEST:
        return None
    motion, agreed = cv2.estimateAffinePartial2D(corners[seen], there[seen], ransacReprojThreshold=2.0)
    if motion is None or agreed.sum() < max(_FEWEST, 0.4 * seen.sum()):
        return None
    zoom = float(np.hypot(motion[0, 0], motion[1, 0]))
    sane = 1 / _LARGEST_SCALE < zoom < _LARGEST_SCALE
    near = np.abs(motion[:, 2]).max() <= _LARGEST_SHIFT * grey.shape[1]
    return np.asarray(motion, np.float64) if sane and near else None


def _shift(
    last: NDArray[np.uint8], grey: NDArray[np.uint8], background: NDArray[np.uint8]
) -> tuple[float, float]:
    """Return how far the last picture has moved as a whole, (x, y), px; 0 where that is unclear.

    What the camera turns towards comes in at one side; the other side's two thirds are still in the picture.
    """
    size = max(1, grey.shape[1] // _COARSE), max(1, grey.shape[0] // _COARSE)
    before, now = (cv2.resize(each, size, interpolation=cv2.INTER_AREA) for each in (last, grey))
    free = cv2.resize(background, size, interpolation=cv2.INTER_NEAREST)
    across, down = int(_LARGEST_SHIFT * size[0]), int(_DOWN * size[1])
    best, shift = _LEAST_LIKE, (0.0, 0.0)
    for begin in (0, across):
        part = slice(down, size[1] - down), slice(begin, size[0] - across + begin)
        if np.count_nonzero(free[part]) < free[part].size / 4:
            continue
        like = cv2.matchTemplate(now, before[part], cv2.TM_CCOEFF_NORMED, mask=free[part])
        like[~np.isfinite(like)] = -1.0
        _, highest, _, (x, y) = cv2.minMaxLoc(like)
        if highest > best:
            best, shift = highest, (float(x - begin) * _COARSE, float(y - down) * _COARSE)
    return shift


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
