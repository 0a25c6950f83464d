"""Means, spreads and 95 % intervals: Student's t for means, Wilson's score for shares."""

from __future__ import annotations

import functools
import math
import statistics
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence

LEVEL = 0.95


@dataclass(frozen=True, slots=True)
class Estimate:
    """A value with the interval that covers the truth in 95 of 100 repetitions; it may be infinite."""

    value: float
    low: float
    high: float

    @property
    def excludes_zero(self) -> bool:
        """The interval excludes zero."""
        return self.low > 0 or self.high < 0

    @property
    def bounds(self) -> list[float | None]:
        """Both bounds, None where there is none."""
        return [bound if math.isfinite(bound) else None for bound in (self.low, self.high)]


def mean_std(values: Sequence[float]) -> tuple[float, float | None]:
    """Return the mean and the sample standard deviation (ddof = 1), which a single value does not have.

    Raises:
        ValueError: there are no values.
    """
    if not values:
        raise ValueError("no values to average")
    return statistics.fmean(values), statistics.stdev(values) if len(values) > 1 else None


def mean_estimate(values: Sequence[float]) -> Estimate:
    """Return the mean of independent values with Student's t interval; a single value bounds nothing.

    Raises:
        ValueError: there are no values.
    """
    if not values:
        raise ValueError("no values to average")
    mean = statistics.fmean(values)
    if len(values) == 1:
        return Estimate(mean, -math.inf, math.inf)
    half = t_quantile(len(values) - 1) * statistics.stdev(values) / math.sqrt(len(values))
    return Estimate(mean, mean - half, mean + half)


def mean_difference(ours: Sequence[float], theirs: Sequence[float]) -> Estimate:
    """Return mean less mean of independent values with Welch's interval, its degrees of freedom rounded down.

    Source: B. L. Welch, "The generalization of 'Student's' problem when several different population
    variances are involved", 1947. A single value on either side bounds nothing.

    Raises:
        ValueError: there are no values.
    """
    if not ours or not theirs:
        raise ValueError("no values to compare")
    less = statistics.fmean(ours) - statistics.fmean(theirs)
    if min(len(ours), len(theirs)) == 1:
        return Estimate(less, -math.inf, math.inf)
    first, second = (statistics.variance(values) / len(values) for values in (ours, theirs))
    if first + second == 0.0:
        return Estimate(less, less, less)
    freedom = (first + second) ** 2 / (first**2 / (len(ours) - 1) + second**2 / (len(theirs) - 1))
    half = t_quantile(max(1, math.floor(freedom + 1e-9))) * math.sqrt(first + second)
    return Estimate(less, less - half, less + half)


def share_estimate(hits: int, count: int) -> Estimate:
    """Return `hits` of `count` independent trials as a share with Wilson's score interval.

    Source: E. B. Wilson, "Probable inference, the law of succession, and statistical inference", 1927.

    Raises:
        ValueError: there are no trials, or hits are no part of them.
    """
    if not 0 <= hits <= count or not count:
        raise ValueError(f"{hits} of {count} is not a share")
    z2 = statistics.NormalDist().inv_cdf((1 + LEVEL) / 2) ** 2
    middle = (hits + z2 / 2) / (count + z2)
    half = math.sqrt(z2 * (hits * (count - hits) / count + z2 / 4)) / (count + z2)
    # At the ends one bound is the share itself, but for rounding.
    low = 0.0 if hits == 0 else middle - half
    high = 1.0 if hits == count else middle + half
    return Estimate(hits / count, low, high)


def share_difference(hits: int, count: int, other_hits: int, other_count: int) -> Estimate:
    """Return share less share of independent trials, with Newcombe's interval from both Wilson intervals.

    Source: R. G. Newcombe, "Interval estimation for the difference between independent proportions", 1998,
    method 10.

    Raises:
        ValueError: there are no trials on a side, or hits are no part of them.
    """
    ours, theirs = share_estimate(hits, count), share_estimate(other_hits, other_count)
    less = ours.value - theirs.value
    return Estimate(
        less,
        less - math.hypot(ours.value - ours.low, theirs.high - theirs.value),
        less + math.hypot(ours.high - ours.value, theirs.value - theirs.low),
    )


@functools.lru_cache(maxsize=256)
def t_quantile(freedom: int) -> float:
    """Return t > 0 with P(|T| <= t) = 0.95 for Student's T of `freedom` >= 1 degrees of freedom."""
    low, high = 0.0, math.pi / 2
    for _ in range(60):
        middle = (low + high) / 2
        low, high = (middle, high) if _within(middle, freedom) < LEVEL else (low, middle)
    return math.tan((low + high) / 2) * math.sqrt(freedom)


def _within(theta: float, freedom: int) -> float:
    """Return P(|T| <= sqrt(freedom) tan(theta)); Abramowitz and Stegun, 26.7.3 and 26.7.4."""
    cos, odd = math.cos(theta), freedom % 2
    term = cos if odd else 1.0
    total = term if freedom > 1 else 0.0
    for k in range(2 + odd, freedom - 1, 2):
        term *= cos * cos * (k - 1) / k
        total += term
    total *= math.sin(theta)
    return 2 / math.pi * (theta + total) if odd else total
