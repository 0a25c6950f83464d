"""Running sums and quantiles of a stream of values, in constant memory."""

from __future__ import annotations

import math
from array import array
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

KEPT = 4096
"""Number of values that are kept as they are; up to it, results are exact."""
ACCURACY = 0.001
"""Relative accuracy of a quantile once there are more values than are kept."""
LEAST, MOST = 1e-3, 1e7
"""The range of that accuracy."""

_GAMMA = (1 + ACCURACY) / (1 - ACCURACY)
_BINS = math.ceil(math.log(MOST / LEAST) / math.log(_GAMMA)) + 1


class RunningSum:
    """A sum, rounded once in `KEPT` values: correctly rounded up to as many."""

    def __init__(self) -> None:
        self._parts = array("d")
        self.count = 0

    def add(self, value: float) -> None:
        """Take one more value."""
        if len(self._parts) == KEPT:
            self._parts = array("d", [self.total()])
        self._parts.append(value)
        self.count += 1

    def total(self) -> float:
        """Return the sum so far; 0 of nothing."""
        return math.fsum(self._parts)


class RunningQuantiles:
    """Quantiles of values that are not negative, such as times; values that are not finite are left out.

    Up to `KEPT` values they are exact. More are counted in bins whose width grows with the value, so that a
    quantile is off by `ACCURACY` of itself at most, between `LEAST` and `MOST`; lesser values all count as
    one, which is off by `LEAST`. The greatest value stays exact.

    Source: C. Masson, J. E. Rim and H. K. Lee, "DDSketch: a fast and fully-mergeable quantile sketch with
    relative-error guarantees", 2019: bin i holds (gamma^(i-1), gamma^i], and 2 gamma^i / (gamma + 1) stands
    for all of it, with gamma = (1 + accuracy) / (1 - accuracy).
    """

    def __init__(self) -> None:
        self._newest = array("d")
        self._counts: NDArray[np.int64] | None = None
        self._least, self._greatest = math.inf, -math.inf

    def add(self, value: float) -> None:
        """Take one more value."""
        if len(self._newest) == KEPT:
            self._count()
        self._newest.append(value)

    def quantiles(self, shares: tuple[float, ...]) -> tuple[float, ...] | None:
        """Return the quantiles of these shares, in [0, 1]; None of nothing.

        They lie between the two nearest values, as numpy's do.
        """
        if self._counts is None:
            exact = _finite(self._newest)
            return tuple(np.quantile(exact, shares).tolist()) if exact.size else None
        self._count()
        upto = np.cumsum(self._counts)
        if not upto[-1]:
            return None
        ranks = np.array(shares) * (upto[-1] - 1)
        below, above = (
            _middle(np.searchsorted(upto, whole, side="right")).clip(self._least, self._greatest)
            for whole in (np.floor(ranks), np.ceil(ranks))
        )
        found = below + (above - below) * (ranks % 1)
        found[ranks == upto[-1] - 1] = self._greatest
        return tuple(found.tolist())

    def _count(self) -> None:
        """Sort the newest values into their bins."""
        values = _finite(self._newest)
        self._newest = array("d")
        if self._counts is None:
            self._counts = np.zeros(_BINS, np.int64)
        if values.size:
            self._counts += np.bincount(_bin(values), minlength=_BINS)
            self._least = min(self._least, float(values.min()))
            self._greatest = max(self._greatest, float(values.max()))


def _finite(values: array[float]) -> NDArray[np.float64]:
    known = np.array(values)
    finite: NDArray[np.float64] = known[np.isfinite(known)]
    return finite


def _bin(values: NDArray[np.float64]) -> NDArray[np.int64]:
    return np.ceil(np.log(values.clip(LEAST, MOST) / LEAST) / math.log(_GAMMA)).astype(np.int64)


def _middle(index: NDArray[np.int64]) -> NDArray[np.float64]:
    return np.asarray(LEAST * 2 / (_GAMMA + 1) * _GAMMA**index, np.float64)
