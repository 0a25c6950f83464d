"""Downsamples a curve for drawing: the extremes of every column are kept."""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray


def envelope(values: NDArray[np.float64], columns: int) -> NDArray[np.intp]:
    """Return the indices of the points to draw, ascending; all of them when there are few.

    The values are cut into `columns` stretches of equal length. Of each its least and greatest stay, so that
    no spike is lost, and its first NaN, so that no gap is bridged; besides these the first and the last value
    of all. See U. Jugel et al., "M4: A Visualization-Oriented Time Series Data Aggregation", 2014.

    Args:
        values: shape (T,); NaN where there is none.
        columns: at least 1.
    """
    count = len(values)
    if count <= 3 * columns:
        return np.arange(count)
    edges = np.linspace(0, count, columns + 1).astype(np.intp)
    kept = [0, count - 1]
    missing = np.isnan(values)
    least, greatest = np.where(missing, np.inf, values), np.where(missing, -np.inf, values)
    for start, end in itertools.pairwise(edges):
        kept += [start + int(least[start:end].argmin()), start + int(greatest[start:end].argmax())]
        gap = int(missing[start:end].argmax())
        if missing[start + gap]:
            kept.append(start + gap)
    return np.unique(np.array(kept, np.intp))
