"""Draws a class mask as a network's input.

Colours are drawn at `draw_size` and then reduced bilinearly, in 8 bits: the way of the published Offline-EVT
policy (160 to 64). Reducing straight from the camera's size would shred arms and legs.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import cv2
import numpy as np
from numpy.typing import NDArray

from adatracker_deploy.core.messages import MaskClass

if TYPE_CHECKING:
    from adatracker_deploy.core.messages import ClassMask
    from adatracker_deploy.policy.manifest import Colour, MaskSpec, Palette


class MaskPainter:
    """Paints class masks as one policy wants them, into buffers that it keeps."""

    def __init__(self, spec: MaskSpec, seed: int = 0) -> None:
        self._spec = spec
        self._drawn = np.empty((spec.draw_size, spec.draw_size, spec.channels), np.uint8)
        self._input = np.empty((spec.channels, spec.size, spec.size), np.float32)
        self.reset(seed)

    def reset(self, seed: int) -> None:
        """Begin an episode: draw from `seed` the one colour that all `random` entries share."""
        self._table = colour_table(self._spec.palette, seed)

    def paint(self, mask: ClassMask) -> NDArray[np.float32]:
        """Return the network's input of shape (C, S, S), overwritten by the next call.

        Args:
            mask: classes, uint8 of shape (H, W) of any size. One that is not square is set in the middle of a
                square: stretched, people would be taller than any that the policy was trained on.
        """
        np.multiply(self.picture(mask).transpose(2, 0, 1), np.float32(self._spec.scale), out=self._input)
        return self._input

    def picture(self, mask: ClassMask) -> NDArray[np.uint8]:
        """Return the same as a picture of shape (S, S, C), before it is scaled."""
        spec = self._spec
        mask = squared(mask)
        if mask.shape != self._drawn.shape[:2]:
            mask = cv2.resize(mask, (spec.draw_size, spec.draw_size), interpolation=cv2.INTER_NEAREST)
        np.take(self._table, mask, axis=0, out=self._drawn, mode="clip")
        reduced = cv2.resize(self._drawn, (spec.size, spec.size), interpolation=cv2.INTER_LINEAR)
        return np.asarray(reduced.reshape(spec.size, spec.size, spec.channels), np.uint8)


def squared(mask: ClassMask) -> ClassMask:
    """Return a mask (H, W) in the middle of a square of background."""
    height, width = mask.shape
    if height == width:
        return mask
    side = max(height, width)
    whole = np.full((side, side), MaskClass.BACKGROUND, np.uint8)
    top, left = (side - height) // 2, (side - width) // 2
    whole[top : top + height, left : left + width] = mask
    return whole


def colour_table(palette: Palette, seed: int) -> NDArray[np.uint8]:
    """Return the colours by `MaskClass`, shape (4, C); `random` ones are drawn from `seed`.

    A random colour is never black, white, the background's or the target's.
    """
    rng = np.random.default_rng(seed)
    channels = len(palette.target)
    taken = {palette.background, palette.target}
    drawn: Colour = palette.target
    while drawn in taken:
        drawn = tuple(map(int, rng.integers(1, 255, size=channels)))
    colours: dict[MaskClass, Colour] = {
        MaskClass.BACKGROUND: palette.background,
        MaskClass.TARGET: palette.target,
        MaskClass.PERSON: drawn if palette.person == "random" else palette.person,
        MaskClass.OBSTACLE: drawn if palette.obstacle == "random" else palette.obstacle,
    }
    return np.array([colours[value] for value in sorted(MaskClass)], np.uint8)
