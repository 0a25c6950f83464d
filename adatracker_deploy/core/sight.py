"""Judges what was seen in a picture by the truth, which only a virtual world knows. Pure."""

from __future__ import annotations

import enum
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from adatracker_deploy.core.messages import Box, MaskClass, at_size

if TYPE_CHECKING:
    from adatracker_deploy.core.messages import ClassMask, Truth

LEAST_PIXELS = 6
"""Pixels of the seen mask: a target that covers fewer in the true one counts as hidden."""


class Verdict(enum.Enum):
    """The judgement of one picture: the target was seen, or the reason why it was not."""

    SEEN = "seen"
    SOMEBODY_ELSE = "somebody_else"
    """The region taken for the target is not the target."""
    NOT_TRUSTED = "not_trusted"
    """The target was found, and taken for somebody else."""
    NOT_FOUND = "not_found"
    """The target is in the picture, and was not found."""
    HIDDEN = "hidden"
    """Something stands before it."""
    OUTSIDE = "outside"
    """It is not in the picture."""

    @property
    def words(self) -> str:
        """The verdict in words for people."""
        return _WORDS[self]


_WORDS = {
    Verdict.SEEN: "seen",
    Verdict.SOMEBODY_ELSE: "somebody else taken for it",
    Verdict.NOT_TRUSTED: "found but not trusted",
    Verdict.NOT_FOUND: "in the picture but not found",
    Verdict.HIDDEN: "hidden",
    Verdict.OUTSIDE: "outside the picture",
}


@dataclass(frozen=True, slots=True)
class Sight:
    """One picture's verdict."""

    verdict: Verdict
    mask_iou: float
    """IoU of the seen with the true target, 0 to 1; 0 where either is empty."""
    true_box: Box | None
    """The target's, of its visible part; None where there is none."""


def judged(seen: ClassMask, truth: Truth) -> Sight:
    """Compare a seen mask with the truth, each of shape (H, W) of its own."""
    true = at_size(truth.mask, *seen.shape)
    taken, target = seen == MaskClass.TARGET, true == MaskClass.TARGET
    on_it, all_taken = int(np.count_nonzero(taken & target)), int(np.count_nonzero(taken))
    size = int(np.count_nonzero(target))
    either = all_taken + size - on_it
    return Sight(
        _verdict(seen, true, truth, on_it=on_it, all_taken=all_taken, size=size),
        on_it / either if either else 0.0,
        Box.of_mask(truth.mask),
    )


def _verdict(
    seen: ClassMask, true: ClassMask, truth: Truth, *, on_it: int, all_taken: int, size: int
) -> Verdict:
    if all_taken:
        on_others = np.count_nonzero((seen == MaskClass.TARGET) & (true == MaskClass.PERSON))
        return Verdict.SEEN if on_it > on_others else Verdict.SOMEBODY_ELSE
    if size < LEAST_PIXELS:
        return Verdict.HIDDEN if truth.in_view else Verdict.OUTSIDE
    found = np.count_nonzero((true == MaskClass.TARGET) & (seen == MaskClass.PERSON))
    return Verdict.NOT_TRUSTED if 2 * found >= size else Verdict.NOT_FOUND
