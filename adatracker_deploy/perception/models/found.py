"""Post-processing: turns a detector's candidates into instances, for every model family."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from adatracker_deploy.core.errors import PlatformError
from adatracker_deploy.perception.boxes import clipped, non_maximum_suppression
from adatracker_deploy.perception.models.image_input import in_boxes
from adatracker_deploy.perception.models.picture import Letterbox
from adatracker_deploy.perception.roles import Instances

CANDIDATES = 1000
"""Number of best candidates that enter non-maximum suppression."""
_ROUNDING = 1e-3


Cut = Callable[[NDArray[np.intp], NDArray[np.float32]], NDArray[np.bool_]]
"""Returns the masks of the candidates at these indices with these boxes, (n, 4) in image px."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Rules:
    """The rules by which candidates become instances."""

    words: Mapping[int, str]
    """The word of each class that is wanted."""
    score: float
    nms_iou: float
    """1 keeps all."""
    limit: int

    @property
    def vocabulary(self) -> tuple[str, ...]:
        """The words, each once, in order of their classes."""
        return tuple(dict.fromkeys(self.words.values()))


@dataclass(frozen=True, slots=True, kw_only=True)
class Candidates:
    """A network's output before filtering."""

    boxes: NDArray[np.float32]
    """Left, top, right, bottom in px of the network's input, shape (n, 4)."""
    scores: NDArray[np.float32]
    """Shape (n,), 0 to 1."""
    classes: NDArray[np.intp]
    """Shape (n,)."""
    cut: Cut | None = None
    """None where the network gives no masks."""


def instances(candidates: Candidates, rules: Rules, place: Letterbox, *, where: str) -> Instances:
    """Return the instances among the candidates, best first.

    Args:
        candidates: the network's output.
        rules: what is wanted.
        place: where the picture lies in the input.
        where: the model, for errors.

    Raises:
        PlatformError: a score is outside 0 to 1.
    """
    scores = candidates.scores
    if len(scores) and (scores.min() < -_ROUNDING or scores.max() > 1 + _ROUNDING):
        raise PlatformError(
            f"{where}: gave scores from {scores.min():.3g} to {scores.max():.3g}; expected 0 to 1"
        )
    wanted = np.isin(candidates.classes, list(rules.words)) & (scores >= rules.score)
    places = np.flatnonzero(wanted)
    places = places[np.argsort(-scores[places], kind="stable")][:CANDIDATES]
    if rules.nms_iou < 1:
        chosen = candidates.boxes[places], scores[places], candidates.classes[places]
        places = places[non_maximum_suppression(*chosen, rules.nms_iou)]
    boxes, whole = clipped(place.boxes_back(candidates.boxes[places]), *place.picture)
    places, boxes = places[whole], boxes[whole]
    places, boxes = places[: rules.limit], boxes[: rules.limit]
    return Instances(
        boxes,
        np.clip(scores[places], 0, 1).astype(np.float32),
        tuple(rules.words[int(index)] for index in candidates.classes[places]),
        None if candidates.cut is None else candidates.cut(places, boxes),
    )


def cutter(
    maps: Callable[[NDArray[np.intp]], NDArray[np.float32]],
    shape: tuple[int, int],
    place: Letterbox,
    above: float,
) -> Cut:
    """Return a function that cuts masks out of maps over the whole input.

    Args:
        maps: gives the maps of the candidates at n places, (n, *shape).
        shape: rows and columns of a map.
        place: where the picture lies in the input.
        above: a mask is where its map is above this.
    """
    cells = place.map_back(np.zeros(shape, np.float32)).shape

    def cut(places: NDArray[np.intp], boxes: NDArray[np.float32]) -> NDArray[np.bool_]:
        masks = np.array([place.map_back(one) > above for one in maps(places)], bool)
        return in_boxes(masks.reshape(-1, *cells), boxes, place.picture)

    return cut


def sigmoid(logits: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return 1 / (1 + exp(-x)) without overflow."""
    return np.asarray(0.5 * (1 + np.tanh(0.5 * logits)), np.float32)
