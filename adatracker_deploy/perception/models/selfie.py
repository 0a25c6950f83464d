"""MediaPipe's selfie segmentation as a mask head: it cuts a person out of a crop around their box.

It marks every person in a crop, so the masks of two overlapping people mix.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor

import cv2
import numpy as np

from adatracker_deploy.perception.models.model_file import ModelFile
from adatracker_deploy.perception.models.session import Network
from adatracker_deploy.perception.models.signature import Port, bind
from adatracker_deploy.perception.roles import Boxes, Masks, Picture

_SIDE = 256
_MARGIN = 0.15
"""Margin around the square crop, as a share of the box's longer side."""
_ABOVE = 0.5
_INPUTS = {"picture": Port(names=("image",), shapes=((1, _SIDE, _SIDE, 3),), dtypes=("float32",))}
_OUTPUTS = {"mask": Port(names=("mask",), shapes=((1, _SIDE, _SIDE, 1),))}


class SelfieMasks:
    """Implements `MaskHead`."""

    def __init__(self, file: ModelFile, *, providers: Sequence[str] = ("cpu",), threads: int = 1) -> None:
        """Start it.

        Raises:
            UsageError: the file is another model.
        """
        fed, given = bind(file, _INPUTS, _OUTPUTS, {})
        self._picture, self._mask = fed["picture"], given["mask"]
        self.networks = (Network(file, providers, threads),)
        self._other_core = ThreadPoolExecutor(1, thread_name_prefix="cut-out")

    def __call__(self, picture: Picture, boxes: Boxes, size: int) -> Masks:
        """Return the masks of the people in the boxes, shape (n, size, size), over the whole picture.

        Raises:
            PlatformError: the network gave what none gives.
        """
        # The first, the target, is cut out here while the others are on the other core.
        first, others = boxes[:1].astype(float), boxes[1:].astype(float)
        coming = [self._other_core.submit(self._cut_out, picture, box, size) for box in others]
        cut = [self._cut_out(picture, box, size) for box in first]
        masks = [*cut, *(mask.result() for mask in coming)]
        return np.array(masks, bool).reshape(len(boxes), size, size)

    def _cut_out(self, picture: Picture, box: np.ndarray, size: int) -> np.ndarray:
        rows, columns = picture.shape[:2]
        middle, half = (box[:2] + box[2:]) / 2, max(box[2:] - box[:2]) * (0.5 + _MARGIN)
        scale = _SIDE / (2 * half)
        to_crop = np.array([[scale, 0, -scale * (middle[0] - half)], [0, scale, -scale * (middle[1] - half)]])
        crop = cv2.warpAffine(picture, to_crop, (_SIDE, _SIDE), flags=cv2.INTER_LINEAR)
        feeds = {self._picture.name: np.multiply(crop, np.float32(1 / 255))[None]}
        (value,) = self.networks[0].run(feeds, (self._mask,))
        # From the crop straight to the small mask, whose cell u lies at x = (u + 0.5) * columns / size - 0.5.
        grow = np.array([columns / size, rows / size])
        shift = scale * (grow / 2 - 0.5 - (middle - half))
        back = np.array([[scale * grow[0], 0, shift[0]], [0, scale * grow[1], shift[1]]])
        small = cv2.warpAffine(
            value[0, :, :, 0], back, (size, size), flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        )
        inside = small > _ABOVE
        left, top, right, bottom = np.rint(box / np.tile([columns, rows], 2) * size).astype(int)
        only = np.zeros_like(inside)
        only[max(0, top - 1) : bottom + 1, max(0, left - 1) : right + 1] = True
        return np.asarray(inside & only)
