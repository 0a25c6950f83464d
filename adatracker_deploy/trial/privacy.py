"""Privacy of bystanders: a log keeps images as captured, blurred, or none."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

import cv2
import numpy as np

from adatracker_deploy.core.messages import MaskClass

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from adatracker_deploy.core.messages import ClassMask

Frames = Literal["full", "blurred", "none"]
"""The camera's pictures that a log keeps."""

CELLS = 16
"""Across the shorter side of a picture: a face that takes a third of it is five cells across."""
MARGIN = 0.04
"""Margin for what a mask misses of a person on each side, in sides of the picture."""
LASTS_S = 1.0
"""Time for which a place stays covered after a person was last seen there: detectors blink."""


class Anonymiser:
    """Blurs everybody in the masks except the target.

    It cannot cover people who are in no mask.
    """

    def __init__(self) -> None:
        self._until_ns = np.zeros((0, 0), np.int64)
        """Until when each pixel of the mask stays covered."""

    def cover(self, rgb: NDArray[np.uint8], mask: ClassMask, t_ns: int) -> NDArray[np.uint8]:
        """Return a picture with them blurred.

        Args:
            rgb: shape (H, W, 3); it is not changed.
            mask: of any size.
            t_ns: when it was captured, ns; never earlier than before.
        """
        if self._until_ns.shape != mask.shape:
            self._until_ns = np.zeros(mask.shape, np.int64)
        seen = (mask == MaskClass.PERSON).astype(np.uint8)
        if seen.any():
            height, width = mask.shape
            reach = (2 * round(MARGIN * width) + 1, 2 * round(MARGIN * height) + 1)
            grown = cv2.dilate(seen, cv2.getStructuringElement(cv2.MORPH_ELLIPSE, reach))
            self._until_ns[grown > 0] = t_ns + round(LASTS_S * 1e9)
        covered = (self._until_ns > t_ns) & (mask != MaskClass.TARGET)
        if not covered.any():
            return rgb
        size = rgb.shape[1], rgb.shape[0]
        shown = cv2.resize(covered.astype(np.uint8), size, interpolation=cv2.INTER_NEAREST) == 0
        return np.where(shown[..., None], rgb, _blurred(rgb))


def _blurred(rgb: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return what is left of a picture when each cell is its mean."""
    height, width = rgb.shape[:2]
    cell = max(1, min(height, width) // CELLS)
    cells = cv2.resize(rgb, (max(1, width // cell), max(1, height // cell)), interpolation=cv2.INTER_AREA)
    return np.asarray(cv2.resize(cells, (width, height), interpolation=cv2.INTER_LINEAR), np.uint8)
