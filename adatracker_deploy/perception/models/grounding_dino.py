"""GroundingDINO: open-vocabulary detection. For key frames only, because it is slow.

logits [1, Q, 256] score each of Q boxes against each token of the caption (minus infinity where there is no
token), boxes [1, Q, 4] are centres and sizes as fractions of the input. A box's score is its best token's,
its word the one whose tokens it scores best on (`groundingdino/util/inference.py`). Exports differ in which
text inputs they have.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.perception.boxes import from_centres
from adatracker_deploy.perception.models.caption import MOST_TOKENS, caption
from adatracker_deploy.perception.models.found import Candidates, Rules, instances, sigmoid
from adatracker_deploy.perception.models.image_input import image_input, picture_port
from adatracker_deploy.perception.models.model_file import ModelFile
from adatracker_deploy.perception.models.rf_detr import IMAGENET
from adatracker_deploy.perception.models.session import Feed, Network
from adatracker_deploy.perception.models.sidecar import Sidecar
from adatracker_deploy.perception.models.signature import TRUTH, WHOLE, Port, bind
from adatracker_deploy.perception.models.wordpiece import WordPiece
from adatracker_deploy.perception.roles import Instances, Picture

_ROW = (1, None)
INPUTS = {
    "picture": picture_port("img", "image", "images", "pixel_values", "samples", "inputs"),
    "input_ids": Port(names=("input_ids",), shapes=(_ROW,), dtypes=WHOLE),
    "token_type_ids": Port(names=("token_type_ids",), shapes=(_ROW,), dtypes=WHOLE),
    "attention_mask": Port(names=("attention_mask",), shapes=(_ROW,), dtypes=TRUTH, optional=True),
    "position_ids": Port(names=("position_ids",), shapes=(_ROW,), dtypes=WHOLE, optional=True),
    "text_token_mask": Port(
        names=("text_token_mask",), shapes=((1, None, None), _ROW), dtypes=TRUTH, optional=True
    ),
    "text_self_attention_masks": Port(
        names=("text_self_attention_masks",), shapes=((1, None, None),), dtypes=TRUTH, optional=True
    ),
    "pixel_mask": Port(names=("pixel_mask",), shapes=((1, None, None),), dtypes=TRUTH, optional=True),
}
OUTPUTS = {
    "logits": Port(names=("logits", "pred_logits"), shapes=((1, None, MOST_TOKENS), (1, None, None))),
    "boxes": Port(names=("boxes", "pred_boxes"), shapes=((1, None, 4),)),
}
SCORE, NMS_IOU = 0.3, 0.7
"""A box's threshold in the reference demo; it suppresses no duplicates, so ours are only the plain ones."""


class GroundingDino:
    """Implements `Detector`; has no words of its own, and is given some when it is made."""

    def __init__(
        self,
        file: ModelFile,
        sidecar: Sidecar,
        words: Sequence[str],
        providers: Sequence[str],
        threads: int,
        *,
        vocabulary: Path,
    ) -> None:
        """Start it.

        Raises:
            UsageError: the file is not what its sidecar says, or a word cannot be written in its vocabulary.
        """
        where = str(file.path)
        fed, self._given = bind(file, INPUTS, OUTPUTS, sidecar.tensors)
        self._input = image_input(file, fed["picture"], sidecar, IMAGENET)
        lengths = {tensor.shape[1] for role, tensor in fed.items() if role not in ("picture", "pixel_mask")}
        fixed = lengths - {None}
        if len(fixed) > 1:
            raise UsageError(f"{where}: its text inputs differ in length: {sorted(map(str, fixed))}")
        self._caption = caption(words, WordPiece.read(vocabulary), next(iter(fixed), None), where=where)
        self._rules = Rules(
            words=dict(enumerate(words)),
            score=sidecar.score or SCORE,
            nms_iou=sidecar.nms_iou or NMS_IOU,
            limit=sidecar.limit,
        )
        said = self._caption
        mask = "text_token_mask" in fed and len(fed["text_token_mask"].shape) == 3
        texts: dict[str, Feed] = {
            "input_ids": said.ids,
            "token_type_ids": np.zeros_like(said.ids),
            "attention_mask": said.real,
            "position_ids": said.positions,
            "text_token_mask": said.attend if mask else said.real,
            "text_self_attention_masks": said.attend,
            "pixel_mask": np.ones(self._input.size, np.int64),
        }
        self._texts = {
            tensor.name: texts[role][None].astype(tensor.dtype)
            for role, tensor in fed.items()
            if role in texts
        }
        self.networks = (Network(file, providers, threads),)

    @property
    def vocabulary(self) -> tuple[str, ...]:
        """The words that it was given."""
        return self._rules.vocabulary

    def __call__(self, picture: Picture, tall: float | None = None) -> Instances:  # noqa: ARG002 -- any scale is as good
        """Return the detections in an image; raises PlatformError if the network's output is invalid."""
        feeds, place = self._input.feed(picture)
        outputs = (self._given["logits"], self._given["boxes"])
        logits, boxes = self.networks[0].run(
            feeds | self._texts, outputs, may_be_absent=(self._given["logits"].name,)
        )
        tokens = sigmoid(logits[0])
        by_word = np.stack([tokens[:, span].max(axis=1) for span in self._caption.spans], axis=1)
        classes = by_word.argmax(axis=1)
        scores = by_word[np.arange(len(classes)), classes]
        rows, columns = self._input.size
        return instances(
            Candidates(
                boxes=from_centres(boxes[0]) * np.array([columns, rows, columns, rows], np.float32),
                scores=scores,
                classes=classes,
            ),
            self._rules,
            place,
            where=self.networks[0].file.path.name,
        )
