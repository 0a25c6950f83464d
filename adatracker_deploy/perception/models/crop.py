"""The square around a person that a mask head looks at, and the way back from it to the whole picture."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import cv2
import numpy as np
from numpy.typing import NDArray

from adatracker_deploy.perception.roles import Picture

SIDE = 256
_ABOVE = 0.5
"""Probability above which a pixel is the person's."""


@dataclass(frozen=True, slots=True)
class Crop:
    """A square of a picture, drawn at `SIDE` x `SIDE` px; black where it is outside the picture."""

    box: NDArray[np.float64]
    """The person's, px of the picture."""
    middle: NDArray[np.float64]
    """Of the square, px."""
    scale: float
    """px of the crop a px of the picture."""

    @classmethod
    def around(cls, box: NDArray[np.float64], margin: float) -> Self:
        """Return the square around a box, with a margin all around, a share of the box's longer side."""
        half = max(box[2:] - box[:2]) * (0.5 + margin)
        return cls(box, (box[:2] + box[2:]) / 2, SIDE / (2 * half))

    def of(self, picture: Picture) -> NDArray[np.float32]:
        """Return the crop as networks of MediaPipe want it: RGB, 0 to 1, shape (1, SIDE, SIDE, 3)."""
        corner = self.middle - SIDE / (2 * self.scale)
        there = np.array([[self.scale, 0, -self.scale * corner[0]], [0, self.scale, -self.scale * corner[1]]])
        crop = cv2.warpAffine(picture, there, (SIDE, SIDE), flags=cv2.INTER_LINEAR)
        return np.asarray(np.multiply(crop, np.float32(1 / 255))[None])

    def covered(self, value: NDArray[np.float32]) -> float:
        """Return the share of the person's box that is the person's.

        Args:
            value: the probability of each px of the crop, shape (SIDE, SIDE).
        """
        box = (self.box - np.tile(self.middle, 2)) * self.scale + SIDE / 2
        (left, top), (right, bottom) = np.floor(box[:2]).astype(int), np.ceil(box[2:]).astype(int)
        return float((value[top:bottom, left:right] > _ABOVE).mean())

    def mask(self, value: NDArray[np.float32], shape: tuple[int, ...], size: int) -> NDArray[np.bool_]:
        """Return the mask (size, size) over the whole picture, nothing of it outside the person's box.

        Args:
            value: the probability of each px of the crop, shape (SIDE, SIDE).
            shape: the picture's.
            size: of the mask. Its cell u lies at x = (u + 0.5) * columns / size - 0.5.
        """
        rows, columns = shape[:2]
        grow = np.array([columns / size, rows / size])
        shift = self.scale * (grow / 2 - 0.5 - self.middle) + SIDE / 2
        back = np.array([[self.scale * grow[0], 0, shift[0]], [0, self.scale * grow[1], shift[1]]])
        flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        inside = cv2.warpAffine(value, back, (size, size), flags=flags) > _ABOVE
        left, top, right, bottom = np.rint(self.box / np.tile([columns, rows], 2) * size).astype(int)
        only = np.zeros_like(inside)
        only[max(0, top - 1) : bottom + 1, max(0, left - 1) : right + 1] = True
        return np.asarray(inside & only)
