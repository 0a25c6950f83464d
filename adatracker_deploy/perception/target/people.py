"""Tracks the people in view: predicts each position and associates boxes with tracks. Pure."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from adatracker_deploy.perception.boxes import centres, heights, overlap, widened, widths
from adatracker_deploy.perception.target.appearance import is_cut, likeness, mixed

if TYPE_CHECKING:
    from collections.abc import Sequence

    from adatracker_deploy.perception.target.appearance import Appearance
    from adatracker_deploy.perception.target.motion import Motion

_SMOOTHING = 0.4
"""Share of a new measurement in a velocity."""
_DRIFT_S = 1.0
"""Time out of sight after which no constant velocity is assumed, and the size no longer follows the camera's
zoom, which is the background's."""
_WIDEN, _WIDEN_PER_S, _WIDEST = 0.2, 0.5, 1.0
"""Boxes are compared with margins of this share of their sides, more the longer somebody was out of sight:
two boxes of a fast person a picture apart need not touch (Yang et al. 2023, "Hard to track objects with
irregular motions and similar appearances? Make it easier by buffering the matching space")."""
_LEAST_OVERLAP = 0.05
_OTHER_SIZE = 0.6
"""Smallest ratio between the heights of two boxes of the same person."""
_OTHER_WIDTH = 0.35
"""The same of the widths, where the picture cuts off the height of either: a head and shoulders are not as
wide as a stride."""
_LOOK_WEIGHT = 2.0
"""Weight of the similarity relative to the IoU."""
_LEAST_SCORE = 0.55
"""Least sum of IoU and weighted similarity."""


@dataclass(frozen=True, slots=True)
class Person:
    """A person's track."""

    box: NDArray[np.float64]
    """Shape (4,), px; while out of sight, the predicted box."""
    look: Appearance
    velocity: NDArray[np.float64]
    """Image velocity of the box's centre without camera motion, px/s, shape (2,)."""
    unseen_s: float = 0.0
    cut: bool = False
    """Whether the picture cut off the box that was seen last, above or below."""

    @classmethod
    def new(cls, box: NDArray[np.float32], look: Appearance) -> Person:
        """Return a new track."""
        return cls(box.astype(np.float64), look, np.zeros(2), cut=is_cut(look))

    @property
    def height(self) -> float:
        """Of the box, px."""
        return float(self.box[3] - self.box[1])

    def expected(self, motion: Motion, dt_s: float) -> Person:
        """Return the track predicted one image ahead by the camera's motion and its own."""
        corners = self.box.reshape(2, 2)
        if self.unseen_s <= _DRIFT_S:
            corners = corners + self.velocity * dt_s
        corners = corners @ motion[:, :2].T + motion[:, 2]
        box = np.hstack((corners.min(axis=0), corners.max(axis=0)))
        # A camera that rolls would let the box of somebody out of sight grow; only its zoom counts.
        zoom = float(np.hypot(motion[0, 0], motion[1, 0])) if self.unseen_s <= _DRIFT_S else 1.0
        half = (self.box[2:] - self.box[:2]) * zoom / 2
        middle = (box[:2] + box[2:]) / 2
        return replace(self, box=np.hstack((middle - half, middle + half)), unseen_s=self.unseen_s + dt_s)

    def seen(self, box: NDArray[np.float32], look: Appearance, learn: float) -> Person:
        """Return the predicted track updated with `box` and a share `learn` of an appearance."""
        found = box.astype(np.float64)
        error = centres(found[None])[0] - centres(self.box[None])[0]
        velocity = self.velocity + _SMOOTHING * error / max(self.unseen_s, 1e-3)
        known = mixed(self.look, look, learn) if learn else self.look
        return Person(found, known, velocity, cut=is_cut(look))

    def alike(self, looks: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return the similarity of each of `looks` to theirs, 0 to 1, shape (n,)."""
        return likeness(looks, self.look)


def assigned(
    people: Sequence[Person],
    boxes: NDArray[np.float64],
    alike: NDArray[np.float64],
    least_alike: Sequence[float],
    cut: NDArray[np.bool_],
) -> tuple[dict[int, int], float]:
    """Associate tracks with boxes, as {index in `people`: index in `boxes`}; greedy, best pair first.

    All tracks compete, so that a person walking in front of the target keeps their own box.

    Args:
        people: where everybody must be now, n of them.
        boxes: what was found, shape (m, 4), px.
        alike: of each person and box, shape (n, m).
        least_alike: for each person, the likeness below which a box is not theirs.
        cut: whether the picture cuts off each box above or below, shape (m,).

    Returns:
        The pairs; and how well they fit, the sum of their IoU and weighted similarity.
    """
    if not len(people) or not len(boxes):
        return {}, 0.0
    score = np.full(alike.shape, -np.inf)
    for row, person in enumerate(people):
        here = person.box[None]
        margin = min(_WIDEST, _WIDEN + _WIDEN_PER_S * person.unseen_s)
        shared = overlap(widened(boxes, margin), widened(here, margin))[:, 0]
        taller, wider = heights(boxes) / heights(here)[0], widths(boxes) / widths(here)[0]
        as_tall = (taller >= _OTHER_SIZE) & (taller <= 1 / _OTHER_SIZE)
        as_wide = (wider >= _OTHER_WIDTH) & (wider <= 1 / _OTHER_WIDTH)
        fits = (
            (shared >= _LEAST_OVERLAP)
            & (alike[row] >= least_alike[row])
            & (as_tall | (as_wide & (cut | person.cut)))
        )
        score[row, fits] = shared[fits] + _LOOK_WEIGHT * alike[row, fits]
    pairs: dict[int, int] = {}
    fit = 0.0
    while True:
        mine, its = divmod(int(score.argmax()), len(boxes))
        if score[mine, its] <= _LEAST_SCORE:
            return pairs, fit
        pairs[mine], fit = its, fit + float(score[mine, its])
        score[mine, :] = -np.inf
        score[:, its] = -np.inf
