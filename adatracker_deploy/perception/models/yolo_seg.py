"""YOLO by Ultralytics (v8, 11, 26, World, E): a raw head or finished boxes, with masks or without.

Raw: output0 [1, 4 + classes (+ 32), anchors], boxes as centres in px of the input, scores after the sigmoid;
finished (`end2end`, or exported with `nms=True`): output0 [1, n, 6 (+ 32)], corners, score, class. With
masks, output1 [1, 32, rows / 4, columns / 4] are the prototypes whose sums, weighted by an instance's 32
coefficients, are its mask's logits (`ultralytics/utils/ops.py`, process_mask). The words of World and E are
those set when they were exported.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.perception.boxes import from_centres
from adatracker_deploy.perception.models.found import Candidates, Rules, cutter, instances
from adatracker_deploy.perception.models.image_input import image_input, picture_port
from adatracker_deploy.perception.models.metadata import Metadata, read_metadata
from adatracker_deploy.perception.models.model_file import ModelFile
from adatracker_deploy.perception.models.picture import Letterbox, Preparation
from adatracker_deploy.perception.models.session import Network
from adatracker_deploy.perception.models.sidecar import Sidecar, class_names
from adatracker_deploy.perception.models.signature import Port, bind
from adatracker_deploy.perception.models.words import choose
from adatracker_deploy.perception.roles import Instances, Picture

INPUTS = {"picture": picture_port("images")}
OUTPUTS = {
    "instances": Port(names=("output0",), shapes=((1, None, None),)),
    "prototypes": Port(names=("output1",), shapes=((1, None, None, None),), optional=True),
}
PREPARATION = Preparation(resize="letterbox")
SCORE, NMS_IOU = 0.25, 0.7
"""Ultralytics' own thresholds (`ultralytics/cfg/default.yaml`: conf, iou)."""
_TASKS = ("detect", "segment")
_PLAIN = 6
"""Numbers of a finished row without coefficients."""


class YoloDetector:
    """Implements `Detector`."""

    def __init__(
        self, file: ModelFile, sidecar: Sidecar, words: Sequence[str], providers: Sequence[str], threads: int
    ) -> None:
        """Start it.

        Raises:
            UsageError: the file is not what it or its sidecar says, or does not know a word.
        """
        where = str(file.path)
        own = read_metadata(file.metadata, where=where)
        if own is not None and own.task not in _TASKS:
            raise UsageError(f"{where}: is made for the task {own.task!r}; expected {' or '.join(_TASKS)}")
        fed, self._given = bind(file, INPUTS, OUTPUTS, sidecar.tensors)
        self._coefficients = 0
        if "prototypes" in self._given:
            self._coefficients = _known(file, self._given["prototypes"].shape[1], "prototypes")
        elif own is not None and own.task == "segment":
            raise UsageError(f"{where}: is made for the task 'segment' but has no output of prototypes")
        self._finished = self._is_finished(file, own)
        self._input = image_input(
            file,
            fed["picture"],
            sidecar,
            PREPARATION,
            size=own.size if own else None,
            stride=own.stride if own else 1,
        )
        names = class_names(sidecar, own.names if own else None, self._classes(file), where=where)
        self._rules = Rules(
            words=choose(names, words, sidecar.synonyms, where=where),
            score=sidecar.score or SCORE,
            nms_iou=sidecar.nms_iou or (1.0 if self._finished else NMS_IOU),
            limit=sidecar.limit,
        )
        self.networks = (Network(file, providers, threads),)

    @property
    def vocabulary(self) -> tuple[str, ...]:
        """The words that it was opened with, or all that it knows."""
        return self._rules.vocabulary

    def __call__(self, picture: Picture, tall: float | None = None) -> Instances:  # noqa: ARG002 -- any scale is as good
        """Return the detections in an image; raises PlatformError if the network's output is invalid."""
        feeds, place = self._input.feed(picture)
        values = self.networks[0].run(feeds, tuple(self._given.values()))
        rows = values[0][0] if self._finished else values[0][0].T
        prototypes = values[1][0] if self._coefficients else None
        return instances(
            self._candidates(rows, prototypes, place),
            self._rules,
            place,
            where=self.networks[0].file.path.name,
        )

    def _candidates(
        self, rows: NDArray[np.float32], prototypes: NDArray[np.float32] | None, place: Letterbox
    ) -> Candidates:
        coefficients = rows[:, rows.shape[1] - self._coefficients :]
        if self._finished:
            boxes, scores, classes = rows[:, :4], rows[:, 4], np.rint(rows[:, 5]).astype(np.intp)
        else:
            table = rows[:, 4 : rows.shape[1] - self._coefficients]
            boxes, scores, classes = from_centres(rows[:, :4]), table.max(axis=1), table.argmax(axis=1)

        cut = None
        if prototypes is not None:
            known = prototypes
            cut = cutter(
                lambda places: np.tensordot(coefficients[places], known, axes=1), known.shape[1:], place, 0.0
            )
        return Candidates(boxes=boxes, scores=scores, classes=classes, cut=cut)

    def _is_finished(self, file: ModelFile, own: Metadata | None) -> bool:
        shape = self._given["instances"].shape
        looks = shape[2] == _PLAIN + self._coefficients
        if own is not None and own.finished != looks:
            expected = f"[1, n, {_PLAIN + self._coefficients}]" if own.finished else "a raw head"
            raise UsageError(
                f"{file.path}: its metadata promise {expected}; found {self._given['instances']}"
            )
        return looks

    def _classes(self, file: ModelFile) -> int | None:
        """Return how many classes the graph scores; finished boxes do not tell."""
        if self._finished:
            return None
        return (
            _known(file, self._given["instances"].shape[1], "channels of the head") - 4 - self._coefficients
        )


def _known(file: ModelFile, size: int | None, what: str) -> int:
    if size is None:
        raise UsageError(f"{file.path}: leaves the number of {what} free; export it with fixed sizes")
    return size
