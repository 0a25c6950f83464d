"""MediaPipe's pose landmark network as a mask head: it cuts out the one person in the middle of a crop.

Unlike the selfie segmentation it leaves out doors, curtains and whoever stands beside. It is trained on whole
people who stand or walk, and says how sure it is that it sees one: whom it doubts, for example somebody who
crouches, the selfie segmentation cuts out.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING

import numpy as np

from adatracker_deploy.perception.models.crop import SIDE, Crop
from adatracker_deploy.perception.models.session import Network
from adatracker_deploy.perception.models.signature import Port, bind
from adatracker_deploy.perception.roles import Boxes, Masks, Picture

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from adatracker_deploy.perception.models.model_file import ModelFile
    from adatracker_deploy.perception.models.selfie import SelfieMasks

_MARGIN = 0.125
"""Margin around the square crop, as a share of the box's longer side: MediaPipe scales the person's square by
1.25 (`pose_landmarks_to_roi` in its repository). Mask IoU of rendered people: 0.929 with it, 0.924 with 0.05,
0.928 with 0.25."""
SURE = 0.9
"""Least probability, by the network, that there is a person. Of 239 rendered people 2 were below it; of 118
pictures of a skateboarder 32, and his masks in them often lacked half of him."""
LEAST_COVERED = 0.3
"""Least share of a box that the network marks of a person in it. Of rendered people's boxes, 95 % are covered
by 0.37 at least."""
_INPUTS = {"picture": Port(names=("image",), shapes=((1, SIDE, SIDE, 3),), dtypes=("float32",))}
_OUTPUTS = {
    "mask": Port(names=("mask",), shapes=((1, SIDE, SIDE, 1),)),
    "flag": Port(names=("flag",), shapes=((1, 1),)),
}


class PoseMasks:
    """Implements `MaskHead`: cuts out the first person, the target, and leaves all others to another head.
    Implements `Witness`.

    Args:
        file: the network.
        otherwise: for the others, on another core meanwhile, and for a target that the network doubts.
        providers: of onnxruntime, the preferred first.
        threads: of one run.

    Raises:
        UsageError: the file is another model.
    """

    def __init__(
        self,
        file: ModelFile,
        otherwise: SelfieMasks,
        *,
        providers: Sequence[str] = ("cpu",),
        threads: int = 1,
    ) -> None:
        fed, given = bind(file, _INPUTS, _OUTPUTS, {})
        self._picture, self._ports = fed["picture"], (given["mask"], given["flag"])
        self._network, self._otherwise = Network(file, providers, threads), otherwise
        self.networks = (self._network, *otherwise.networks)
        self._other_core = ThreadPoolExecutor(1, thread_name_prefix="cut-out")

    def __call__(self, picture: Picture, boxes: Boxes, size: int) -> Masks:
        """Return the masks of the people in the boxes, shape (n, size, size), over the whole picture.

        Raises:
            PlatformError: a network gave what none gives.
        """
        others = self._other_core.submit(self._otherwise, picture, boxes[1:], size)
        masks = [self._cut_out(picture, box, size) for box in boxes[:1]]
        return np.concatenate((np.array(masks, bool).reshape(-1, size, size), others.result()))

    def person_in(self, picture: Picture, box: NDArray[np.float32]) -> float:
        """Return the probability that a box, shape (4,), px, is a person's.

        The crop is square: that of somebody slender, or of a tree, shows who stands beside. So there is
        nobody where the network marks little of the box.

        Raises:
            PlatformError: the network gave what none gives.
        """
        crop, value, flag = self._looked_at(picture, box)
        return flag if crop.covered(value) >= LEAST_COVERED else 0.0

    def _cut_out(self, picture: Picture, box: NDArray[np.float32], size: int) -> NDArray[np.bool_]:
        crop, value, flag = self._looked_at(picture, box)
        if flag < SURE:
            return np.asarray(self._otherwise(picture, box[None], size)[0])
        return crop.mask(value, picture.shape, size)

    def _looked_at(
        self, picture: Picture, box: NDArray[np.float32]
    ) -> tuple[Crop, NDArray[np.float32], float]:
        """Return the crop around a box, what the network marks in it, and the probability of a person."""
        crop = Crop.around(box.astype(float), _MARGIN)
        value, flag = self._network.run({self._picture.name: crop.of(picture)}, self._ports)
        return crop, value[0, :, :, 0], float(flag[0, 0])
