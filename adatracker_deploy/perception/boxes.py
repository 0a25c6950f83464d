"""Boxes as corners in pixels: left, top, right, bottom; arrays of shape (n, 4), any float dtype."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]


def overlaps(boxes: Array, others: Array) -> NDArray[np.float64]:
    """Return the intersection over union of each of `boxes` (n) with each of `others` (m), shape (n, m)."""
    corner = np.maximum(boxes[:, None, :2], others[None, :, :2])
    opposite = np.minimum(boxes[:, None, 2:], others[None, :, 2:])
    shared = (opposite - corner).clip(0).prod(axis=2)
    return np.asarray(shared / (areas(boxes)[:, None] + areas(others)[None] - shared), np.float64)


def areas(boxes: Array) -> Array:
    """Return the areas, px^2, shape (n,)."""
    return np.asarray((boxes[:, 2:] - boxes[:, :2]).prod(axis=1))


def centres(boxes: Array) -> Array:
    """Return the middles (x, y), shape (n, 2)."""
    return np.asarray((boxes[:, :2] + boxes[:, 2:]) / 2)


def heights(boxes: Array) -> Array:
    """Return the heights, px, shape (n,)."""
    return np.asarray(boxes[:, 3] - boxes[:, 1])


def widened(boxes: Array, share: float) -> Array:
    """Return the boxes with `share` of their own width and height added on every side."""
    margins = (boxes[:, 2:] - boxes[:, :2]) * share
    return np.hstack((boxes[:, :2] - margins, boxes[:, 2:] + margins))
