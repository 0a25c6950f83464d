"""SAM2's memory bank of the tracked object. Pure: arrays in, arrays out.

After `sam2/modeling/sam2_base.py`, _prepare_memory_conditioned_features: the prompted frame and the last six,
each with its age's temporal code, and the pointers of the prompted frame and the last fifteen. Pointers carry
no position: the known exports leave SAM 2.1's projection of it out.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FRAMES, POINTERS = 7, 16
"""num_maskmem and max_obj_ptrs_in_encoder of the published models; the prompted frame counts."""

Values = NDArray[np.float32]


@dataclass(frozen=True, slots=True)
class Remembered:
    """One frame's memory."""

    features: Values
    """Shape (1, ...): whatever the memory encoder gives of one frame."""
    positions: Values
    """Shape (T, 1, M): one for each token of the features."""
    pointer: Values
    """Shape (1, P): P is a multiple of M."""


class MemoryBank:
    """The prompted frame, and those after it."""

    def __init__(self, prompted: Remembered, temporal: Values) -> None:
        """Begin.

        Args:
            prompted: the first frame's.
            temporal: codes of age, shape (7, ..., M): the newest frame's first, the prompted one's last.
        """
        self._prompted = prompted
        self._temporal = temporal.reshape(len(temporal), 1, 1, -1)
        self._recent: deque[Remembered] = deque(maxlen=POINTERS - 1)

    def add(self, frame: Remembered) -> None:
        """Remember the newest frame; the oldest but the prompted one is forgotten."""
        self._recent.appendleft(frame)

    def recall(self) -> tuple[Values, Values, Values]:
        """Return the features (n, ...), the pointers (m, P) and the positions (n T + m P / M, 1, M)."""
        newest = list(self._recent)
        frames = [self._prompted, *newest[: FRAMES - 1]]
        ages = [len(self._temporal) - 1, *range(len(frames) - 1)]
        pointers = np.concatenate([frame.pointer for frame in (self._prompted, *newest)])
        placed = [frame.positions + self._temporal[age, 0] for frame, age in zip(frames, ages, strict=True)]
        width = self._prompted.positions.shape[-1]
        unplaced = np.zeros((pointers.size // width, 1, width), np.float32)
        features = np.concatenate([frame.features for frame in frames])
        return features, pointers, np.concatenate([*placed, unplaced]).astype(np.float32)
