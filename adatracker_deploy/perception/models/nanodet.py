"""NanoDet-g, the small detector of COCO's 80 classes that is shipped (github.com/RangiLyu/nanodet).

Each cell of three grids (strides 8, 16, 32) gives the score of every class and, for each side of a box, a
distribution over the distances 0 to 10; its mean times the stride is the distance from the cell's centre to
that side (generalised focal loss, Li et al. 2020, section 3.2).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from adatracker_deploy.core.errors import PlatformError, UsageError
from adatracker_deploy.perception.models.coco import COCO80
from adatracker_deploy.perception.models.found import Candidates, Rules, instances
from adatracker_deploy.perception.models.image_input import picture_port
from adatracker_deploy.perception.models.model_file import ModelFile
from adatracker_deploy.perception.models.picture import Preparation, fit, prepare
from adatracker_deploy.perception.models.session import Network
from adatracker_deploy.perception.models.signature import Port, bind
from adatracker_deploy.perception.models.words import choose
from adatracker_deploy.perception.roles import Instances, Picture

STRIDES = (8, 16, 32)
SIDE = 416
"""Length to which an image's longer side is scaled, px: the size used in training."""
SCORE = 0.35
"""Score threshold; on street footage every second person box between 0.35 and 0.5 is false."""
_STEP = STRIDES[-1]
"""Sides are multiples of it."""
_WEAK_PX = ((115.0, 185.0), (245.0, float("inf")))
"""Heights of upright people in the network's input at which their score falls by half, and many are missed:
median 0.31 to 0.58 at 120 to 165 px, 0.73 to 0.87 at 75 to 105 and 195 to 225; on street footage and in
rendered scenes alike (docs/segmenters.md)."""
NMS_IOU = 0.6
_BINS = 11
_DISTANCES = np.arange(_BINS, dtype=np.float32)
_IMAGENET_BGR = Preparation(
    colour="bgr",
    scale=1.0,
    mean=(103.53, 116.28, 123.675),
    std=(57.375, 57.12, 58.395),
    padding=0,
)
_INPUTS = {"picture": picture_port("image")}
_OUTPUTS = {
    **{f"cls{stride}": Port(names=(f"cls{stride}",), shapes=((1, None, len(COCO80)),)) for stride in STRIDES},
    **{f"reg{stride}": Port(names=(f"reg{stride}",), shapes=((1, None, 4 * _BINS),)) for stride in STRIDES},
}


class NanoDet:
    """Implements `Detector` for pictures of any size."""

    def __init__(
        self,
        file: ModelFile,
        words: Sequence[str] = (),
        *,
        side: int = SIDE,
        score: float = SCORE,
        providers: Sequence[str] = ("cpu",),
        threads: int = 1,
    ) -> None:
        """Start it.

        Args:
            file: the model.
            words: what to look for; none: everything it knows.
            side: to which a picture's longer side is brought, px, a multiple of 32; smaller is faster.
            score: the least that is returned.
            providers: where to run it, by preference.
            threads: for the processor's share of the work.

        Raises:
            UsageError: the file is another model, a word is unknown, the side is not a multiple of 32.
        """
        if side < STRIDES[-1] or side % STRIDES[-1]:
            raise UsageError(f"{file.path}: side {side}: expected a multiple of {STRIDES[-1]}")
        self._side = side
        fed, self._given = bind(file, _INPUTS, _OUTPUTS, {})
        self._picture = fed["picture"].name
        self._rules = Rules(
            words=choose(COCO80, words, {}, where=str(file.path)), score=score, nms_iou=NMS_IOU, limit=100
        )
        self._columns = np.array(sorted(self._rules.words), np.intp)
        self.networks = (Network(file, providers, threads),)

    @property
    def vocabulary(self) -> tuple[str, ...]:
        """The words that it was opened with, or all that it knows."""
        return self._rules.vocabulary

    def __call__(self, picture: Picture, tall: float | None = None) -> Instances:
        """Return the detections in an image; raises PlatformError if the network's output is invalid."""
        rows, columns = picture.shape[:2]
        side = self._side if tall is None else suited_side(tall, self._side)
        place = fit((rows, columns), _input_size(rows, columns, side), "letterbox_corner")
        feeds = {self._picture: prepare(picture, place, _IMAGENET_BGR)}
        values = dict(zip(self._given, self.networks[0].run(feeds, tuple(self._given.values())), strict=True))
        self._check_grids(values, place.size)
        found = [
            self._decoded(
                values[f"cls{stride}"][0], values[f"reg{stride}"][0], stride, place.size[1] // stride
            )
            for stride in STRIDES
        ]
        boxes, scores, classes = (np.concatenate(parts) for parts in zip(*found, strict=True))
        return instances(
            Candidates(boxes=boxes, scores=scores, classes=classes),
            self._rules,
            place,
            where=self.networks[0].file.path.name,
        )

    def _check_grids(self, values: Mapping[str, NDArray[np.float32]], size: tuple[int, int]) -> None:
        """Check that each grid has a row for each of its cells; otherwise all boxes would be misplaced."""
        for name, value in values.items():
            stride = int(name[3:])
            cells = size[0] // stride * (size[1] // stride)
            if value.shape[1] != cells:
                raise PlatformError(
                    f"{self.networks[0].file.path.name}: gave {name} for {value.shape[1]} cells; "
                    f"an input of {size[0]} x {size[1]} has {cells}"
                )

    def _decoded(
        self, classes: NDArray[np.float32], sides: NDArray[np.float32], stride: int, across: int
    ) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.intp]]:
        """Return the boxes, px of the input, scores and classes of one grid's cells above the threshold."""
        wanted = classes[:, self._columns]
        cells, places = np.nonzero(wanted >= self._rules.score)
        logits = sides[cells].reshape(-1, 4, _BINS)
        weights = np.exp(logits - logits.max(axis=2, keepdims=True, initial=-np.inf))
        left, top, right, bottom = ((weights @ _DISTANCES) / weights.sum(axis=2) * stride).T
        x, y = (cells % across + 0.5) * stride, (cells // across + 0.5) * stride
        boxes = np.stack((x - left, y - top, x + right, y + bottom), axis=1).astype(np.float32)
        return boxes, wanted[cells, places], self._columns[places]


def suited_side(tall: float, largest: int = SIDE) -> int:
    """Return the largest side at which somebody is not of a height that the network is weak at, px.

    Args:
        tall: their height, share of the picture's longer side.
        largest: the largest side to choose, px.
    """
    sides = range(largest, _STEP, -_STEP)
    return next((side for side in sides if not _weak(tall * side)), largest)


def _weak(tall_px: float) -> bool:
    return any(low < tall_px < high for low, high in _WEAK_PX)


def _input_size(rows: int, columns: int, side: int) -> tuple[int, int]:
    """Return rows and columns of the input: the longer is `side`, the other what the strides allow above."""
    step = STRIDES[-1]
    shorter = min(rows, columns) * side / max(rows, columns)
    other = min(side, max(step, int(np.ceil(round(shorter) / step)) * step))
    return (other, side) if columns >= rows else (side, other)
