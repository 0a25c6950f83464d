"""NanoDet-g: an anchor-free detector of COCO's 80 classes for small processors.

Each cell of three grids (strides 8, 16, 32) gives the score of every class and, for each side of a box, a
distribution over 11 distances, whose mean times the stride is the distance from the cell's centre to that side
(generalised focal loss, Li et al. 2020, section 3.2; network by RangiLyu, github.com/RangiLyu/nanodet).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import cv2
import numpy as np
from numpy.typing import NDArray

from adatracker_deploy.errors import PlatformError
from adatracker_deploy.perception.embedded.coco import COCO
from adatracker_deploy.perception.roles import Boxes, Instances, Picture

Run = Callable[[dict[str, NDArray[np.float32]]], Mapping[str, NDArray[np.float32]]]
"""A network: its inputs by name, its outputs by name."""

STRIDES = (8, 16, 32)
_BINS = 11
"""Distances 0 to 10, in strides."""
_MEAN = np.array((103.53, 116.28, 123.675), np.float32)
_STD = np.array((57.375, 57.12, 58.395), np.float32)
"""Of ImageNet, in the order blue, green, red."""
_STEP = 32
"""Sides are multiples of the coarsest stride."""
_SIDES = np.arange(_BINS, dtype=np.float32)


class NanoDet:
    """A `Detector` for pictures of any size.

    Args:
        run: the network.
        words: what to look for, out of `COCO`.
        side: to which the picture's longer side is brought, px, a multiple of 32.
        threshold: of the score, 0 to 1; what is below is not there.
        overlap: intersection over union above which, of two boxes of one word, only the better counts.

    Raises:
        ValueError: a word is not of the vocabulary, or the side is no multiple of 32.
    """

    vocabulary = COCO

    def __init__(
        self, run: Run, words: tuple[str, ...], *, side: int = 416, threshold: float = 0.35, overlap: float = 0.6
    ) -> None:
        if side < _STEP or side % _STEP:
            raise ValueError(f"side {side}: expected a multiple of {_STEP}")
        self._run = run
        self._columns = np.array([COCO.index(word) for word in words])
        self._side = side
        self._threshold = threshold
        self._overlap = overlap

    def __call__(self, picture: Picture) -> Instances:
        """Return the things of those words, best first.

        Raises:
            PlatformError: the network gave another shape, or numbers that are none.
        """
        height, width = picture.shape[:2]
        size = fitted_size(width, height, self._side)
        outputs = self._run({"image": to_input(picture, size)})
        boxes, scores, columns = [], [], []
        for stride in STRIDES:
            found = _decode(outputs, stride, size, self._columns, self._threshold)
            for into, part in zip((boxes, scores, columns), found, strict=True):
                into.append(part)
        scale = np.array((width / size[0], height / size[1]) * 2, np.float32)
        every = np.concatenate(boxes) * scale
        every[:, 0::2] = every[:, 0::2].clip(0, width)
        every[:, 1::2] = every[:, 1::2].clip(0, height)
        return _best(every, np.concatenate(scores), self._columns[np.concatenate(columns)], self._overlap)


def fitted_size(width: int, height: int, side: int) -> tuple[int, int]:
    """Return width and height, px, of the network's input: the longer is `side`, both multiples of 32."""
    scale = side / max(width, height)
    return (
        max(_STEP, round(width * scale / _STEP) * _STEP),
        max(_STEP, round(height * scale / _STEP) * _STEP),
    )


def to_input(picture: Picture, size: tuple[int, int]) -> NDArray[np.float32]:
    """Return the picture as the network takes it: BGR, standardised, float32 of shape (1, 3, H, W)."""
    small = cv2.resize(picture, size, interpolation=cv2.INTER_LINEAR)[:, :, ::-1]
    planes = ((small - _MEAN) / _STD).transpose(2, 0, 1)
    return np.ascontiguousarray(planes[None], np.float32)


def _decode(
    outputs: Mapping[str, NDArray[np.float32]],
    stride: int,
    size: tuple[int, int],
    columns: NDArray[np.intp],
    threshold: float,
) -> tuple[Boxes, NDArray[np.float32], NDArray[np.intp]]:
    """Return boxes in px of the input, scores, and places in `columns`, of what passes the threshold."""
    across, down = size[0] // stride, size[1] // stride
    classes, sides = outputs[f"cls{stride}"], outputs[f"reg{stride}"]
    expected = (1, across * down, len(COCO)), (1, across * down, 4 * _BINS)
    if (classes.shape, sides.shape) != expected:
        raise PlatformError(
            f"detector: gave shapes {classes.shape} and {sides.shape}, expected {expected[0]} and {expected[1]}"
        )
    wanted = classes[0][:, columns]
    if not np.isfinite(wanted).all():
        raise PlatformError("detector: gave scores that are no numbers")
    cells, places = np.nonzero(wanted >= threshold)
    logits = sides[0, cells].reshape(-1, 4, _BINS)
    if not np.isfinite(logits).all():
        raise PlatformError("detector: gave boxes that are no numbers")
    weights = np.exp(logits - logits.max(axis=2, keepdims=True))
    distances = (weights @ _SIDES) / weights.sum(axis=2) * stride
    x, y = ((cells % across) + 0.5) * stride, ((cells // across) + 0.5) * stride
    left, top, right, bottom = distances.T
    boxes = np.stack((x - left, y - top, x + right, y + bottom), axis=1).astype(np.float32)
    return boxes, wanted[cells, places], places


def _best(
    boxes: Boxes, scores: NDArray[np.float32], classes: NDArray[np.intp], overlap: float
) -> Instances:
    """Drop what is empty and what a better box of its own class covers."""
    solid = np.flatnonzero(((boxes[:, 2:] - boxes[:, :2]) >= 1).all(axis=1))
    if not solid.size:
        return Instances.none()
    boxes, scores, classes = boxes[solid], scores[solid], classes[solid]
    corner_and_size = np.hstack((boxes[:, :2], boxes[:, 2:] - boxes[:, :2]))
    kept = np.asarray(
        cv2.dnn.NMSBoxesBatched(corner_and_size.tolist(), scores.tolist(), classes.tolist(), 0.0, overlap), np.intp
    )
    kept = kept[np.argsort(-scores[kept], kind="stable")]
    return Instances(boxes[kept], scores[kept], tuple(COCO[index] for index in classes[kept]))
