"""Propagates the target's mask between images, beside the detector and the lock.

Only the lock decides who the target is. The propagator starts from the mask of the lock's target. If the
detector missed its object, that is offered to the lock as another person; its mask is drawn if it lies in the
lock's box. A propagator that disagrees with the lock is restarted.
"""

from __future__ import annotations

import contextlib
from typing import TYPE_CHECKING, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.perception.boxes import clipped, overlap
from adatracker_deploy.perception.roles import Instances

if TYPE_CHECKING:
    from adatracker_deploy.perception.roles import Picture, Propagator

_SAME = 0.5
"""Overlap from which a mask's box and a person's are one: a box may hold an arm that the mask lost."""
_APART = 3
"""Pictures in a row in which lock and propagator disagree, until the lock's word counts."""

Mask = NDArray[np.bool_]


class Followed(NamedTuple):
    """The person that the propagator follows, in one picture."""

    box: NDArray[np.float32]
    """Px, shape (4,)."""
    mask: Mask
    """Over the whole picture, shape (h, w)."""
    score: float
    trusted: bool
    """In the picture before it followed whom the lock tracked."""

    def among(self, people: Instances, word: str) -> Instances:
        """Return the detector's people, and this one, called `word`, if the detector missed them."""
        if overlap(people.boxes, self.box[None]).max(initial=0.0) >= _SAME:
            return people
        masks = people.masks
        if masks is not None:
            masks = np.concatenate((masks, resized(self.mask, masks.shape[1:])[None]))
        return Instances(
            np.vstack((people.boxes, self.box)).astype(np.float32),
            np.append(people.scores, np.float32(self.score)),
            (*people.words, word),
            masks,
        )


class Propagation:
    """A propagator that is kept on the lock's target."""

    def __init__(self, propagator: Propagator) -> None:
        self._propagator = propagator
        self.reset()

    def reset(self) -> None:
        """Forget the target."""
        self._started = False
        self._seen: Followed | None = None
        self._apart = 0
        self._agreed = False

    def step(self, picture: Picture) -> Followed | None:
        """Return whom the propagator follows in the next picture, RGB (H, W, 3); None while out of sight.

        Raises:
            PlatformError: the model gave what no such model gives.
        """
        self._seen, trusted, self._agreed = None, self._agreed, False
        if self._started:
            mask, score = self._propagator.step(picture)
            box = box_of(mask, *picture.shape[:2])
            self._seen = None if box is None else Followed(box, mask, score, trusted)
        return self._seen

    def mask_of(self, box: NDArray[np.float32]) -> Mask | None:
        """Return the propagator's mask if it is of the person in this box, px, shape (4,)."""
        if self._seen is None or overlap(self._seen.box[None], box[None])[0, 0] < _SAME:
            return None
        return self._seen.mask

    def keep(self, picture: Picture, box: NDArray[np.float32], mask: Mask) -> None:
        """Take note of where the lock has the target; start there, if the propagator follows something else.

        Args:
            picture: RGB, shape (H, W, 3).
            box: px, shape (4,).
            mask: the target's over the whole picture, of any resolution.

        Raises:
            PlatformError: the model gave what no such model gives.
        """
        if self.mask_of(box) is not None:
            self._apart, self._agreed = 0, True
            return
        self._apart += 1
        if not self._started or self._apart >= _APART:
            with contextlib.suppress(UsageError):  # a mask too small for the model: the next one may do
                self._propagator.start(picture, mask)
                self._started, self._apart = True, 0


def box_of(mask: Mask, height: int, width: int) -> NDArray[np.float32] | None:
    """Return the box of a mask's largest piece in px of a picture of this size; None where it holds nothing.

    Args:
        mask: over the whole picture, shape (h, w); specks beside the thing do not count.
        height: of the picture, px.
        width: of the picture, px.
    """
    count, _, pieces, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8))
    if count < 2:
        return None
    left, top, columns, rows, _ = pieces[1 + int(pieces[1:, cv2.CC_STAT_AREA].argmax())]
    scale = np.array([width / mask.shape[1], height / mask.shape[0]] * 2, np.float32)
    boxes, held = clipped(
        np.array([[left, top, left + columns, top + rows]], np.float32) * scale, height, width
    )
    return np.asarray(boxes[0]) if len(held) else None


def resized(mask: Mask, shape: tuple[int, int]) -> Mask:
    """Return a mask at another resolution (rows, columns)."""
    if mask.shape == shape:
        return mask
    return np.asarray(cv2.resize(mask.astype(np.uint8), shape[::-1], interpolation=cv2.INTER_NEAREST) > 0)
