"""Exact tests for few trials; every p-value is two-sided.

They assume no distribution: what they count is how many of the ways in which chance could have dealt out the
same results differ at least as much as those seen. So their p-value cannot fall below one over the number
of ways, which for five trials is not small, and `Test.least` says it.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

ALPHA = 0.05
MAX_WAYS = 200_000
"""More ways than that are sampled: 10 against 10 trials have 184,756."""
SAMPLED_WAYS = 20_000
_TIE = 1e-9
"""Differences that are equal but for rounding, relative to the largest value."""


@dataclass(frozen=True, slots=True)
class Test:
    """The result of a test."""

    __test__ = False  # no test of pytest's

    p: float
    """Share of the ways that differ at least as much as what was seen; in (0, 1]."""
    least: float
    """The smallest p that so many trials can give, whatever they show."""
    exact: bool = True
    """Every way was counted; otherwise `SAMPLED_WAYS` drawn with a fixed seed."""

    @property
    def separates(self) -> bool:
        """The difference is significant at the 5 % level."""
        return self.p < ALPHA


def fisher(hits: int, count: int, other_hits: int, other_count: int) -> Test:
    """Test whether two shares differ, by Fisher's exact test: all tables that are no likelier than this one.

    Source: R. A. Fisher, "The Design of Experiments", 1935, section 11; two-sided as by Freeman and Halton,
    "Note on an exact treatment of contingency, goodness of fit and other problems of significance", 1951.

    Raises:
        ValueError: there are no trials on a side, or hits are no part of them.
    """
    if not (count and other_count and 0 <= hits <= count and 0 <= other_hits <= other_count):
        raise ValueError(f"{hits} of {count} against {other_hits} of {other_count} are no shares")
    together = hits + other_hits

    def ways(ours: int) -> int:
        return math.comb(count, ours) * math.comb(other_count, together - ours)

    seen = ways(hits)
    tables = map(ways, range(max(0, together - other_count), min(count, together) + 1))
    total = math.comb(count + other_count, together)
    return Test(sum(table for table in tables if table <= seen) / total, _least_of_split(count, other_count))


def permutation(ours: Sequence[float], theirs: Sequence[float]) -> Test:
    """Test whether independent values differ in their mean, over all ways to deal them out to the two sides.

    Source: E. J. G. Pitman, "Significance tests which may be applied to samples from any populations", 1937.
    Where the ways are too many they are sampled, and p is (found + 1) / (drawn + 1) (B. Phipson and
    G. K. Smyth, "Permutation p-values should never be zero", 2010).

    Raises:
        ValueError: a side is empty.
    """
    if not ours or not theirs:
        raise ValueError("no values to compare")
    values = np.array([*ours, *theirs], dtype=np.float64)
    values -= values.mean()  # so that equal means are a sum of zero
    seen, exact = abs(values[: len(ours)].sum()), True
    if math.comb(len(values), len(ours)) <= MAX_WAYS:
        chosen = np.array(list(itertools.combinations(range(len(values)), len(ours))))
        sums = values[chosen].sum(axis=1)
    else:
        rng, exact = np.random.default_rng(0), False
        dealt = (rng.permutation(values)[: len(ours)].sum() for _ in range(SAMPLED_WAYS))
        sums = np.fromiter(dealt, np.float64, SAMPLED_WAYS)
    return Test(
        _share_as_far(sums, seen, values, exact=exact), _least_of_split(len(ours), len(theirs)), exact
    )


def sign_flip(differences: Sequence[float]) -> Test:
    """Test whether paired differences have a mean other than zero, over all ways to swap within the pairs.

    Source: R. A. Fisher, "The Design of Experiments", 1935, section 21. Sampled as `permutation` is.

    Raises:
        ValueError: there are no differences.
    """
    if not differences:
        raise ValueError("no values to compare")
    values = np.array(differences, dtype=np.float64)
    count, exact = len(values), 2 ** len(values) <= MAX_WAYS
    if exact:
        swapped = np.arange(2**count)[:, None] >> np.arange(count) & 1
    else:
        swapped = np.random.default_rng(0).integers(0, 2, (SAMPLED_WAYS, count))
    sums = (1.0 - 2.0 * swapped) @ values
    return Test(_share_as_far(sums, abs(values.sum()), values, exact=exact), 2.0 ** (1 - count), exact)


def _share_as_far(
    sums: NDArray[np.float64], seen: float, values: NDArray[np.float64], *, exact: bool
) -> float:
    slack = _TIE * float(np.abs(values).max())
    found = int((np.abs(sums) >= seen - slack).sum())
    return found / len(sums) if exact else (found + 1) / (len(sums) + 1)


def _least_of_split(count: int, other_count: int) -> float:
    """One way of them all, or two where the sides are equal and can trade places."""
    ways = math.comb(count + other_count, count)
    return (2 if count == other_count else 1) / ways
