"""Decides whether a tracked object is still in sight, by area and displacement. Pure."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

SMALLEST, LARGEST = 2e-4, 0.8
"""Shares of the picture: less is noise, more is the full-picture mask that a lost SAM2 likes to give."""
MOST_GROWTH = 4.0
"""How many times larger or smaller a thing may be than when it was last seen."""
FARTHEST = 1.5
"""How far its centre may move between two pictures, in diagonals of its last box; so much again for each that
it was out of sight. Chosen, not measured."""


class Sight:
    """Checks a mask against the last one in which the object was seen."""

    def __init__(self, mask: NDArray[np.bool_]) -> None:
        """Begin with its mask, shape (h, w)."""
        self._shape = _measure(mask)
        self._missed = 0

    def sees(self, mask: NDArray[np.bool_]) -> bool:
        """Return whether this mask, shape (h, w), shows it; remembers it if so."""
        share = float(mask.mean())
        last, now = self._shape, _measure(mask)
        seen = SMALLEST <= share <= LARGEST and last is not None and now is not None
        if seen and last is not None and now is not None:
            growth = now[2] / last[2]
            moved = float(np.hypot(now[0] - last[0], now[1] - last[1])) / last[3]
            patience = 1 + self._missed
            seen = 1 / (MOST_GROWTH * patience) <= growth <= MOST_GROWTH * patience
            seen = seen and moved <= FARTHEST * patience
        self._missed = 0 if seen else self._missed + 1
        if seen:
            self._shape = now
        return seen


def _measure(mask: NDArray[np.bool_]) -> tuple[float, float, float, float] | None:
    """Return centre x, centre y, area and the box's diagonal, as shares of the picture; None of nothing."""
    rows, columns = np.nonzero(mask)
    if not len(rows):
        return None
    height, width = mask.shape
    sides = (np.ptp(columns) + 1) / width, (np.ptp(rows) + 1) / height
    return (
        float(columns.mean() / width),
        float(rows.mean() / height),
        float(mask.mean()),
        float(np.hypot(*sides)),
    )
