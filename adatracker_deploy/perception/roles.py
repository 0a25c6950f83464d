"""The parts of a segmenter: detector, mask head and propagator.

All of them take pictures as RGB uint8 of shape (H, W, 3) and give boxes in that picture's pixels.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from collections.abc import Sequence

Picture = NDArray[np.uint8]
"""RGB, shape (H, W, 3)."""
Boxes = NDArray[np.float32]
"""Left, top, right, bottom in px, shape (n, 4); inside the picture, right > left and bottom > top."""
Masks = NDArray[np.bool_]
"""Shape (n, h, w), each over the whole picture, whatever the resolution h x w."""


@dataclass(frozen=True, slots=True)
class Instances:
    """A detector's n detections in one image, best first."""

    boxes: Boxes
    scores: NDArray[np.float32]
    """Shape (n,), 0 to 1."""
    words: tuple[str, ...]
    """The class of each, in the words of the detector's vocabulary."""
    masks: Masks | None = None
    """None where the detector gives no masks."""

    @classmethod
    def none(cls) -> Instances:
        """Return empty detections."""
        return cls(np.empty((0, 4), np.float32), np.empty(0, np.float32), ())

    def __len__(self) -> int:
        return len(self.words)

    def only(self, keep: Sequence[int] | NDArray[np.intp]) -> Instances:
        """Return the detections at the indices `keep`, in that order."""
        places = np.asarray(keep, np.intp)
        return Instances(
            self.boxes[places],
            self.scores[places],
            tuple(self.words[place] for place in places),
            None if self.masks is None else self.masks[places],
        )

    def __add__(self, others: Instances) -> Instances:
        """Return these detections and, after them, others of the same detector."""
        masks = None
        if self.masks is not None and others.masks is not None:
            masks = np.concatenate((self.masks, others.masks))
        return Instances(
            np.concatenate((self.boxes, others.boxes)),
            np.concatenate((self.scores, others.scores)),
            (*self.words, *others.words),
            masks,
        )


class Detector(Protocol):
    """Detects objects of its vocabulary."""

    @property
    def vocabulary(self) -> tuple[str, ...]:
        """The words it knows; one that takes any text has none, and is given its words when it is made."""

    def __call__(self, picture: Picture, tall: float | None = None) -> Instances:
        """Return the detections in an image.

        Args:
            picture: the image.
            tall: the person's height, share of the picture's longer side, if it is known; a detector
                that finds people better at some scales than at others may choose its own by it.

        Raises:
            PlatformError: the model gave what no such model gives.
        """


class MaskHead(Protocol):
    """Segments objects within their boxes."""

    def __call__(self, picture: Picture, boxes: Boxes, size: int) -> Masks:
        """Return the masks of what is in the boxes, shape (n, size, size)."""


class Witness(Protocol):
    """Says, apart from the detector, whether somebody is there."""

    def person_in(self, picture: Picture, box: NDArray[np.float32]) -> float:
        """Return the probability that a box, shape (4,), px, is a person's.

        Raises:
            PlatformError: the model gave what no such model gives.
        """


class Propagated(NamedTuple):
    """The tracked object in the next image."""

    mask: NDArray[np.bool_]
    """Shape (h, w), over the whole picture; empty where it is out of sight."""
    score: float
    """The model's confidence that the object is in sight, 0 to 1."""


class Propagator(Protocol):
    """Tracks one object from image to image by its mask."""

    def start(self, picture: Picture, mask: NDArray[np.bool_]) -> None:
        """Begin with the thing's mask over this picture, of any resolution; forgets what came before.

        Raises:
            UsageError: there is nothing to follow: the mask is empty, or too small for the model.
            PlatformError: the model gave what no such model gives.
        """

    def step(self, picture: Picture) -> Propagated:
        """Return where it is in the next picture.

        Raises:
            PlatformError: the model gave what no such model gives.
        """
