"""People who sit down for a while, by themselves."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np

MEAN_UP_S = 20.0
"""Mean time for which somebody is up."""
DOWN_S = (3.0, 8.0)
"""Shortest and longest time for which somebody sits."""
MOVE_S = 1.6
"""To sit down takes as long as the shipped people's animation, and so does standing up."""


class Rest:
    """One person's state: up or seated. It begins up.

    Args:
        rng: decides when, and for how long.
    """

    def __init__(self, rng: np.random.Generator) -> None:
        self._rng = rng
        self._left_s = float(rng.exponential(MEAN_UP_S))
        self._down_s = 0.0
        """Whole duration of the present rest; 0 while up."""

    @property
    def seated(self) -> float:
        """Share of the time that sitting down takes, 0 (up) to 1; it runs backward to stand up."""
        if not self._down_s:
            return 0.0
        return max(0.0, min(1.0, (self._down_s - self._left_s) / MOVE_S, self._left_s / MOVE_S))

    @property
    def walking(self) -> bool:
        """Whether they are up."""
        return not self._down_s

    def step(self, dt_s: float) -> None:
        """Let `dt_s` seconds pass, at most as long as it takes to sit down."""
        self._left_s -= dt_s
        if self._left_s > 0.0:
            return
        if self._down_s:
            self._down_s, self._left_s = 0.0, float(self._rng.exponential(MEAN_UP_S))
        else:
            self._down_s = self._left_s = 2.0 * MOVE_S + float(self._rng.uniform(*DOWN_S))
