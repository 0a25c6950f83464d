"""Terrain: flat, or a triangulated grid of heights."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, eq=False, slots=True, kw_only=True)
class Terrain:
    """Heights over a square around the origin; beyond it the edge's height continues."""

    half_m: float
    heights: NDArray[np.float64]
    """Shape (N, N), m, rows along y and columns along x, both rising; N is 1 for flat ground."""

    @property
    def is_flat(self) -> bool:
        """Return whether the ground is one level plane at height 0."""
        return self.heights.size == 1

    @property
    def lowest_m(self) -> float:
        """Height of the lowest point."""
        return float(self.heights.min())

    def height(self, x: float, y: float) -> float:
        """Return the ground's height, m, on the same triangles that MuJoCo casts its rays against.

        MuJoCo splits each cell of a height field along the diagonal from its corner at low x and low y.
        """
        if self.is_flat:
            return 0.0
        last = self.heights.shape[0] - 1
        column = min(max((x / self.half_m + 1.0) / 2.0 * last, 0.0), last)
        row = min(max((y / self.half_m + 1.0) / 2.0 * last, 0.0), last)
        c, r = min(int(column), last - 1), min(int(row), last - 1)
        u, v = column - c, row - r
        (low, right), (up, high) = self.heights[r : r + 2, c : c + 2].tolist()
        if u >= v:
            return float(low + u * (right - low) + v * (high - right))
        return float(low + v * (up - low) + u * (high - up))

    def slope(self, x: float, y: float, yaw: float, reach_m: float = 0.3) -> tuple[float, float]:
        """Return the (roll, pitch) in radians of an object of half-length `reach_m` on the ground there."""
        if self.is_flat:
            return 0.0, 0.0
        dx, dy = reach_m * math.cos(yaw), reach_m * math.sin(yaw)
        rise = self.height(x + dx, y + dy) - self.height(x - dx, y - dy)
        lean = self.height(x - dy, y + dx) - self.height(x + dy, y - dx)
        return math.atan2(lean, 2 * reach_m), -math.atan2(rise, 2 * reach_m)


FLAT = Terrain(half_m=1.0, heights=np.zeros((1, 1)))
