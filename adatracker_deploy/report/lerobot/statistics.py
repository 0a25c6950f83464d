"""Statistics of features as lerobot keeps them: extremes, mean, deviation and quantiles of each number."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

QUANTILES = {"q01": 0.01, "q10": 0.1, "q50": 0.5, "q90": 0.9, "q99": 0.99}
LEVELS = 256
EVERY_PX = 4
"""Step between the pixels that count, each way, as lerobot reduces pictures for this."""

Statistics = dict[str, Any]
"""By name, nested lists: a number each (D,), or a channel each (3, 1, 1); `count` is (1,)."""


def of_numbers(values: NDArray[Any]) -> Statistics:
    """Return statistics of rows (N, D), or (N,) for D = 1; N at least 1."""
    rows = values.reshape(len(values), -1).astype(np.float64)
    found = {"min": rows.min(0), "max": rows.max(0), "mean": rows.mean(0), "std": rows.std(0)}
    found |= dict(zip(QUANTILES, np.quantile(rows, list(QUANTILES.values()), axis=0), strict=True))
    return {**{name: value.tolist() for name, value in found.items()}, "count": [len(rows)]}


class PictureTally:
    """Histogram of each channel of some pictures: all that their statistics need.

    Attributes:
        levels: (3, 256) int64.
        count: of the pictures.
    """

    def __init__(self) -> None:
        self.levels = np.zeros((3, LEVELS), np.int64)
        self.count = 0

    def add(self, rgb: NDArray[np.uint8]) -> None:
        """Take a picture, shape (H, W, 3)."""
        few = rgb[::EVERY_PX, ::EVERY_PX]
        for channel in range(3):
            self.levels[channel] += np.bincount(few[..., channel].ravel(), minlength=LEVELS)
        self.count += 1

    def merge(self, other: PictureTally) -> None:
        """Take all the pictures that another one took."""
        self.levels += other.levels
        self.count += other.count

    def statistics(self) -> Statistics:
        """Return the statistics of levels from 0 to 1; at least one picture was taken."""
        level = np.arange(LEVELS) / (LEVELS - 1)
        share = self.levels / self.levels.sum(1, keepdims=True)
        mean = share @ level
        below = share.cumsum(1)
        found = {
            "min": level[(self.levels > 0).argmax(1)],
            "max": level[LEVELS - 1 - (self.levels > 0)[:, ::-1].argmax(1)],
            "mean": mean,
            "std": np.sqrt(np.maximum(share @ level**2 - mean**2, 0.0)),
            **{name: level[(below >= at - 1e-12).argmax(1)] for name, at in QUANTILES.items()},
        }
        return {
            **{name: value.reshape(3, 1, 1).tolist() for name, value in found.items()},
            "count": [self.count],
        }
