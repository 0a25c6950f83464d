"""Initial choice of the target: by a rule, a point, a box or an index, or by nothing but a click."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, cast, get_args

import numpy as np

from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.perception.boxes import centres, overlap

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from adatracker_deploy.perception.roles import Boxes

Rule = Literal["ahead", "largest", "central", "best", "click"]
"""Whom the robot points at, the nearer the rather; the largest box; the one nearest the image centre; the one
with the best score; or nobody by itself: the operator clicks on somebody (`picks`)."""
BY_CLICK: Rule = "click"

_LEAST_OVERLAP = 0.3
_AIM = 0.15
"""Standard deviation of where the target is beside the middle, widths of the picture: 17 degrees of 90.

A box counts by the root of its area, and so by how near they are, times the normal density of its place
(`benchmarks/eyes.py --starts`). From 0.1 to 0.25, all do about as well."""


@dataclass(frozen=True, slots=True)
class Choice:
    """A rule for choosing the target; `str` is the inverse of `Choice.read`."""

    rule: Rule = "ahead"
    numbers: tuple[float, ...] = ()
    """A point (x, y) or a box (left, top, right, bottom) in fractions of the picture; instead of the rule."""
    index: int | None = None
    """From 0, of the people from left to right; instead of the rule."""

    @classmethod
    def read(cls, text: str) -> Choice:
        """Read a rule's name, ``#2``, ``0.5,0.6`` or ``0.4,0.2,0.6,0.9``.

        Raises:
            UsageError: it is not one of them.
        """
        if text in get_args(Rule):
            return cls(rule=cast("Rule", text))
        if re.fullmatch(r"#[1-9]\d?", text):
            return cls(index=int(text[1:]) - 1)
        try:
            numbers = tuple(float(part) for part in text.split(","))
        except ValueError:
            numbers = ()
        is_box = len(numbers) == 4 and numbers[0] < numbers[2] and numbers[1] < numbers[3]
        if (len(numbers) == 2 or is_box) and all(0 <= number <= 1 for number in numbers):
            return cls(numbers=numbers)
        raise UsageError(
            f"target {text!r}: expected {', '.join(get_args(Rule))}, #N (Nth from the left), X,Y or "
            "LEFT,TOP,RIGHT,BOTTOM in fractions of the picture"
        )

    def __call__(self, boxes: Boxes, scores: NDArray[np.float32]) -> int | None:
        """Return the index of the chosen one among boxes; None while nobody qualifies.

        Args:
            boxes: everybody's, in fractions of the picture, shape (n, 4).
            scores: the detector's, shape (n,).
        """
        if not len(boxes) or self.rule == BY_CLICK:
            return None
        if self.index is not None:
            order = np.argsort(boxes[:, 0], kind="stable")
            return int(order[self.index]) if self.index < len(order) else None
        if len(self.numbers) == 4:
            shared = overlap(boxes, np.array([self.numbers], np.float32))[:, 0]
            return int(shared.argmax()) if shared.max() >= _LEAST_OVERLAP else None
        if self.numbers:
            return _at(self.numbers, boxes)
        if self.rule == "best":
            merits = scores
        elif self.rule == "central":
            merits = -_distances(boxes, (0.5, 0.5))
        else:
            merits = np.sqrt((boxes[:, 2:] - boxes[:, :2]).prod(axis=1))
            if self.rule == "ahead":
                merits = merits * np.exp(-(((centres(boxes)[:, 0] - 0.5) / _AIM) ** 2) / 2)
        return int(merits.argmax())


def _at(point: tuple[float, ...], boxes: Boxes) -> int | None:
    """Return the box that contains the point; of several, the one with the nearest centre."""
    x, y = point
    left, top, right, bottom = boxes.T
    holding = np.flatnonzero((left <= x) & (x <= right) & (top <= y) & (y <= bottom))
    return int(holding[_distances(boxes[holding], point).argmin()]) if holding.size else None


def _distances(boxes: Boxes, point: tuple[float, ...]) -> NDArray[np.float32]:
    return np.asarray(np.linalg.norm(centres(boxes) - np.array(point, np.float32), axis=1))
