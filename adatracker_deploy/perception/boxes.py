"""Boxes as corners in pixels: left, top, right, bottom, shape (n, 4). Pure functions of arrays."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Boxes = NDArray[np.floating[Any]]
"""Left, top, right, bottom, shape (n, 4); results have the dtype of what came in, unless they say another."""

SMALLEST_PX = 1.0
"""Smallest width and height of a box, px; smaller ones are empty."""


def from_centres(boxes: Boxes) -> Boxes:
    """Turn (centre x, centre y, width, height) into (left, top, right, bottom), shape (n, 4)."""
    half = boxes[:, 2:] / 2
    return np.concatenate([boxes[:, :2] - half, boxes[:, :2] + half], axis=1)


def centres(boxes: Boxes) -> Boxes:
    """Return the centres (x, y), shape (n, 2)."""
    return np.asarray((boxes[:, :2] + boxes[:, 2:]) / 2)


def heights(boxes: Boxes) -> Boxes:
    """Return the heights, px, shape (n,)."""
    return np.asarray(boxes[:, 3] - boxes[:, 1])


def widths(boxes: Boxes) -> Boxes:
    """Return the widths, px, shape (n,)."""
    return np.asarray(boxes[:, 2] - boxes[:, 0])


def widened(boxes: Boxes, share: float) -> Boxes:
    """Return the boxes with `share` of their own width and height added on every side."""
    margins = (boxes[:, 2:] - boxes[:, :2]) * share
    return np.hstack((boxes[:, :2] - margins, boxes[:, 2:] + margins))


def overlap(a: Boxes, b: Boxes) -> NDArray[np.float32]:
    """Return intersection over union of each box of `a` with each of `b`, shape (len(a), len(b))."""
    low = np.maximum(a[:, None, :2], b[None, :, :2])
    high = np.minimum(a[:, None, 2:], b[None, :, 2:])
    shared = np.clip(high - low, 0, None).prod(axis=2)
    areas = (np.clip(box[:, 2:] - box[:, :2], 0, None).prod(axis=1) for box in (a, b))
    area_a, area_b = areas
    union = area_a[:, None] + area_b[None, :] - shared
    return np.asarray(shared / np.maximum(union, 1e-9), np.float32)


def within(boxes: Boxes, other: Boxes) -> NDArray[np.float32]:
    """Return the share of each box's area that lies within another box, shape (4,)."""
    sides = np.minimum(boxes[:, 2:], other[2:]) - np.maximum(boxes[:, :2], other[:2])
    areas = np.clip(boxes[:, 2:] - boxes[:, :2], 0, None).prod(axis=1)
    return np.asarray(np.clip(sides, 0, None).prod(axis=1) / np.maximum(areas, 1e-9), np.float32)


def non_maximum_suppression(
    boxes: Boxes, scores: NDArray[np.float32], classes: NDArray[np.intp], iou: float
) -> NDArray[np.intp]:
    """Return the indices of the boxes to keep, best first: greedy non-maximum suppression per class.

    Args:
        boxes: shape (n, 4).
        scores: shape (n,).
        classes: shape (n,); boxes of two classes never suppress each other.
        iou: IoU threshold: of two boxes of one class with a higher IoU, the better one is kept.
    """
    order = np.argsort(-scores, kind="stable")
    rivals = overlap(boxes[order], boxes[order]) > iou
    rivals &= classes[order][:, None] == classes[order][None, :]
    alive = np.ones(len(order), bool)
    for place in range(len(order)):
        if alive[place]:
            alive[place + 1 :] &= ~rivals[place, place + 1 :]
    return np.asarray(order[alive], np.intp)


def clipped(boxes: Boxes, height: int, width: int) -> tuple[Boxes, NDArray[np.intp]]:
    """Clip boxes to an image of this size; return all boxes, and the indices of those that are not empty."""
    limits = np.array([width, height, width, height], np.float32)
    inside = np.clip(boxes, 0, limits).astype(np.float32)
    sides = inside[:, 2:] - inside[:, :2]
    return inside, np.flatnonzero((sides >= SMALLEST_PX).all(axis=1))
