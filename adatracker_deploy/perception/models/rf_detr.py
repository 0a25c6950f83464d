"""RF-DETR by Roboflow, with masks or without.

dets [1, Q, 4] are centres and sizes as fractions of the picture; labels [1, Q, classes] logits, with the
published weights by COCO's category numbers (1 is person, 91 in all); masks [1, Q, rows, columns] logits over
the whole picture. Pictures are stretched, and normalised as ImageNet's are (`rfdetr` documentation, "ONNX
inference").
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.perception.boxes import from_centres
from adatracker_deploy.perception.models.found import Candidates, Cut, Rules, cutter, instances, sigmoid
from adatracker_deploy.perception.models.image_input import image_input, picture_port
from adatracker_deploy.perception.models.model_file import ModelFile
from adatracker_deploy.perception.models.picture import Letterbox, Preparation
from adatracker_deploy.perception.models.session import Network
from adatracker_deploy.perception.models.sidecar import Sidecar, class_names
from adatracker_deploy.perception.models.signature import Port, bind
from adatracker_deploy.perception.models.words import choose
from adatracker_deploy.perception.roles import Instances, Picture

INPUTS = {"picture": picture_port("input", "images")}
OUTPUTS = {
    "boxes": Port(names=("dets",), shapes=((1, None, 4),)),
    "logits": Port(names=("labels",), shapes=((1, None, None),)),
    "masks": Port(names=("masks",), shapes=((1, None, None, None),), optional=True),
}
IMAGENET = Preparation(mean=(0.485, 0.456, 0.406), std=(0.229, 0.224, 0.225))
SCORE = 0.5
"""`rfdetr`'s own threshold (RFDETR.predict)."""
_PUBLISHED_CLASSES = 91


class RfDetrDetector:
    """Implements `Detector`."""

    def __init__(
        self, file: ModelFile, sidecar: Sidecar, words: Sequence[str], providers: Sequence[str], threads: int
    ) -> None:
        """Start it.

        Raises:
            UsageError: the file is not what its sidecar says, or does not know a word.
        """
        where = str(file.path)
        fed, self._given = bind(file, INPUTS, OUTPUTS, sidecar.tensors)
        self._input = image_input(file, fed["picture"], sidecar, IMAGENET)
        classes = self._given["logits"].shape[2]
        if classes is None:
            raise UsageError(f"{where}: does not fix the number of classes; export it with fixed sizes")
        if sidecar.names is None and classes == _PUBLISHED_CLASSES:
            names = class_names(Sidecar(kind="rf_detr", names="coco91"), None, classes, where=where)
        else:
            names = class_names(sidecar, None, classes, where=where)
        self._rules = Rules(
            words=choose(names, words, sidecar.synonyms, where=where),
            score=sidecar.score or SCORE,
            nms_iou=sidecar.nms_iou or 1.0,  # trained to give each thing one box
            limit=sidecar.limit,
        )
        self._middle = 0.0 if sidecar.masks == "logits" else 0.5
        self.networks = (Network(file, providers, threads),)

    @property
    def vocabulary(self) -> tuple[str, ...]:
        """The words that it was opened with, or all that it knows."""
        return self._rules.vocabulary

    def check(self, picture: Picture) -> None:
        """Look whether the masks are what the sidecar says.

        Raises:
            UsageError: they are declared logits, but none is outside 0 to 1, as if a sigmoid had been there.
        """
        if "masks" not in self._given or self._middle:
            return
        feeds, _ = self._input.feed(picture)
        (masks,) = self.networks[0].run(feeds, (self._given["masks"],))
        if masks.min() >= 0 and masks.max() <= 1 and masks.max() > masks.min():
            raise UsageError(
                f"{self.networks[0].file.path}: its masks lie from {masks.min():.2g} to {masks.max():.2g}, "
                "as probabilities do: write `masks: probabilities` in the sidecar"
            )

    def __call__(self, picture: Picture, tall: float | None = None) -> Instances:  # noqa: ARG002 -- any scale is as good
        """Return the detections in an image; raises PlatformError if the network's output is invalid."""
        feeds, place = self._input.feed(picture)
        values = self.networks[0].run(feeds, tuple(self._given.values()))
        scores = sigmoid(values[1][0])
        classes = scores.argmax(axis=1)
        rows, columns = self._input.size
        sides = np.array([columns, rows, columns, rows], np.float32)
        return instances(
            Candidates(
                boxes=from_centres(values[0][0]) * sides,
                scores=scores[np.arange(len(classes)), classes],
                classes=classes,
                cut=self._cut(values, place),
            ),
            self._rules,
            place,
            where=self.networks[0].file.path.name,
        )

    def _cut(self, values: list[NDArray[np.float32]], place: Letterbox) -> Cut | None:
        if len(values) <= len(OUTPUTS) - 1:
            return None
        maps = values[2][0]
        return cutter(lambda places: maps[places], maps.shape[1:], place, self._middle)
