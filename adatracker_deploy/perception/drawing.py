"""Draws detections into a class mask; nearer ones cover farther ones."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from collections.abc import Sequence

    from adatracker_deploy.core.messages import ClassMask
    from adatracker_deploy.perception.roles import Masks

MASK_SIZE = 160
"""Rows and columns in which masks are drawn, and the class mask's longer side: the size that policies use."""


def mask_shape(height: int, width: int) -> tuple[int, int]:
    """Return the rows and columns of the class mask of a picture: `MASK_SIZE` along its longer side."""
    longer = max(height, width)
    return max(1, round(MASK_SIZE * height / longer)), max(1, round(MASK_SIZE * width / longer))


def class_mask(
    masks: Sequence[NDArray[np.bool_]],
    values: Sequence[int],
    bottoms: NDArray[np.floating[Any]],
    size: int = MASK_SIZE,
) -> ClassMask:
    """Draw objects into one mask, from the farthest to the nearest.

    Args:
        masks: of the n things, shape (h, w) each, over the whole picture.
        values: the `MaskClass` of each.
        bottoms: lower edge of each, px, shape (n,): on level ground lower means nearer.
        size: rows and columns of the result.
    """
    drawn = np.zeros((size, size), np.uint8)
    for place in np.argsort(bottoms, kind="stable"):
        drawn[_at_size(masks[place], size)] = values[place]
    return drawn


def ellipses(boxes: NDArray[np.float32], width: int, height: int, size: int = MASK_SIZE) -> Masks:
    """Return ellipses that fill their boxes, for objects without a mask.

    Args:
        boxes: px, shape (n, 4).
        width: of the picture, px.
        height: of the picture, px.
        size: rows and columns of the result.
    """
    masks = np.zeros((len(boxes), size, size), np.uint8)
    scaled = boxes * (np.array([size / width, size / height] * 2))
    for mask, (left, top, right, bottom) in zip(masks, scaled, strict=True):
        axes = max(1, round((right - left) / 2)), max(1, round((bottom - top) / 2))
        cv2.ellipse(mask, (round((left + right) / 2), round((top + bottom) / 2)), axes, 0, 0, 360, 1, -1)
    return masks.astype(bool)


def _at_size(mask: NDArray[np.bool_], size: int) -> NDArray[np.bool_]:
    if mask.shape == (size, size):
        return mask
    small = cv2.resize(mask.astype(np.uint8), (size, size), interpolation=cv2.INTER_AREA)
    return (
        np.asarray(small > 0)
        if mask.shape[0] < size
        else np.asarray(
            cv2.resize(mask.astype(np.float32), (size, size), interpolation=cv2.INTER_AREA) >= 0.5
        )
    )
