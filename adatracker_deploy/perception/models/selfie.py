"""MediaPipe's selfie segmentation as a mask head: it cuts a person out of a crop around their box.

It marks every person in a crop, so the masks of two overlapping people mix.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from adatracker_deploy.perception.models.crop import SIDE, Crop
from adatracker_deploy.perception.models.model_file import ModelFile
from adatracker_deploy.perception.models.session import Network
from adatracker_deploy.perception.models.signature import Port, bind
from adatracker_deploy.perception.roles import Boxes, Masks, Picture

_MARGIN = 0.15
"""Margin around the square crop, as a share of the box's longer side."""
_INPUTS = {"picture": Port(names=("image",), shapes=((1, SIDE, SIDE, 3),), dtypes=("float32",))}
_OUTPUTS = {"mask": Port(names=("mask",), shapes=((1, SIDE, SIDE, 1),))}


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

    def __call__(self, picture: Picture, boxes: Boxes, size: int) -> Masks:
        """Return the masks of the people in the boxes, shape (n, size, size), over the whole picture.

        Raises:
            PlatformError: the network gave what none gives.
        """
        masks = [self._cut_out(picture, box, size) for box in boxes.astype(float)]
        return np.array(masks, bool).reshape(len(boxes), size, size)

    def _cut_out(self, picture: Picture, box: np.ndarray, size: int) -> np.ndarray:
        crop = Crop.around(box, _MARGIN)
        (value,) = self.networks[0].run({self._picture.name: crop.of(picture)}, (self._mask,))
        return crop.mask(value[0, :, :, 0], picture.shape, size)
