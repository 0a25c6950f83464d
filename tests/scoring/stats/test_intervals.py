"""Intervals are those of the textbooks, and cover what they promise to cover."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from adatracker_deploy.scoring.stats.intervals import (
    mean_estimate,
    mean_std,
    share_difference,
    share_estimate,
    t_quantile,
)

TABLE = {1: 12.706, 2: 4.303, 3: 3.182, 5: 2.571, 10: 2.228, 15: 2.131, 30: 2.042, 120: 1.980}
"""Student's t, two-sided 95 %, as printed in any textbook."""

values = st.lists(st.floats(-1e3, 1e3), min_size=2, max_size=30)


@pytest.mark.parametrize(("freedom", "t"), TABLE.items())
def test_t_is_the_textbooks(freedom, t):
    assert t_quantile(freedom) == pytest.approx(t, abs=6e-4)


def test_t_falls_to_the_normal_quantile():
    quantiles = [t_quantile(freedom) for freedom in range(1, 500)]
    assert quantiles == sorted(quantiles, reverse=True)
    assert quantiles[-1] == pytest.approx(1.95996, abs=6e-3)


@given(values)
def test_the_mean_is_in_the_middle_of_its_interval(numbers):
    estimate = mean_estimate(numbers)
    assert estimate.value == pytest.approx(np.mean(numbers), abs=1e-9)
    assert estimate.low <= estimate.value <= estimate.high
    assert estimate.high - estimate.value == pytest.approx(estimate.value - estimate.low, abs=1e-9)


@given(values, st.floats(-100, 100), st.floats(0.1, 10))
def test_shift_and_scale_carry_over_to_the_interval(numbers, shift, scale):
    estimate = mean_estimate(numbers)
    moved = mean_estimate([scale * number + shift for number in numbers])
    for name in ("value", "low", "high"):
        assert getattr(moved, name) == pytest.approx(scale * getattr(estimate, name) + shift, abs=1e-6)


def test_the_interval_of_a_mean_covers_the_truth_in_95_of_100(measured):
    draws = np.random.default_rng(0).normal(3.0, 2.0, (4000, 5)).tolist()
    covered = sum(estimate.low <= 3.0 <= estimate.high for estimate in map(mean_estimate, draws)) / len(draws)
    measured(f"coverage of 95 % intervals at n = 5: Student's t {covered:.1%} of {len(draws)}")
    assert covered == pytest.approx(0.95, abs=0.012)


def test_intervals_of_shares_cover_the_truth_in_about_95_of_100(measured):
    """Wilson's covers 95 % on average over the truths, not at each: shares of five come in six sizes."""
    rng, rounds = np.random.default_rng(1), 20_000
    truths = rng.uniform(0, 1, (rounds, 2))
    hits = rng.binomial(5, truths)
    ones = [share_estimate(int(ours), 5) for ours, _ in hits]
    twos = [share_difference(int(ours), 5, int(theirs), 5) for ours, theirs in hits]
    one = np.mean([each.low <= ours <= each.high for each, (ours, _) in zip(ones, truths, strict=True)])
    two = np.mean(
        [each.low <= ours - theirs <= each.high for each, (ours, theirs) in zip(twos, truths, strict=True)]
    )
    measured(f"coverage of 95 % intervals at n = 5: Wilson {one:.1%}, Newcombe {two:.1%} of {rounds}")
    assert one == pytest.approx(0.95, abs=0.01)
    assert two == pytest.approx(0.95, abs=0.01)


def test_a_single_value_bounds_nothing():
    estimate = mean_estimate([7.0])
    assert (estimate.value, estimate.low, estimate.high) == (7.0, -math.inf, math.inf)
    assert not estimate.excludes_zero


@pytest.mark.parametrize(
    ("hits", "count", "low", "high"), [(8, 10, 0.490, 0.943), (0, 10, 0.0, 0.278), (81, 263, 0.255, 0.366)]
)
def test_wilson_is_the_literatures(hits, count, low, high):
    """81 of 263: R. G. Newcombe, Statistics in Medicine 17 (1998), Table I, method 3."""
    estimate = share_estimate(hits, count)
    assert (estimate.low, estimate.high) == (pytest.approx(low, abs=6e-4), pytest.approx(high, abs=6e-4))


@pytest.mark.parametrize(
    ("ours", "theirs", "low", "high"),
    [
        ((56, 70), (48, 80), 0.0524, 0.3339),
        ((9, 10), (3, 10), 0.1705, 0.8090),
        ((5, 56), (0, 29), -0.0381, 0.1926),
        ((0, 10), (0, 20), -0.1611, 0.2775),
    ],
)
def test_the_difference_of_shares_is_newcombes(ours, theirs, low, high):
    """R. G. Newcombe, Statistics in Medicine 17 (1998) 873-890, Table II, method 10."""
    estimate = share_difference(*ours, *theirs)
    assert (estimate.low, estimate.high) == (pytest.approx(low, abs=6e-5), pytest.approx(high, abs=6e-5))


@given(st.integers(1, 2000).flatmap(lambda count: st.tuples(st.integers(0, count), st.just(count))))
def test_a_share_and_its_mirror_image_are_inside_0_and_1(case):
    hits, count = case
    estimate, mirrored = share_estimate(hits, count), share_estimate(count - hits, count)
    assert 0 <= estimate.low <= hits / count <= estimate.high <= 1
    assert estimate.low == pytest.approx(1 - mirrored.high, abs=1e-12)


@pytest.mark.parametrize("wrong", [(0, 0), (3, 2), (-1, 4)])
def test_what_is_no_share_is_refused(wrong):
    with pytest.raises(ValueError, match="not a share"):
        share_estimate(*wrong)


def test_the_std_is_that_of_a_sample_and_one_value_has_none():
    assert mean_std([1.0, 2.0, 3.0]) == (2.0, 1.0)
    assert mean_std([4.0]) == (4.0, None)


def test_no_values_have_no_mean():
    with pytest.raises(ValueError, match="no values"):
        mean_estimate([])
