"""Intervals are those of the textbooks, and cover what they promise to cover."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from adatracker_deploy.evaluation.intervals import mean_estimate, share_estimate, t_quantile

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


def test_the_interval_of_a_mean_covers_the_truth_in_95_of_100():
    draws = np.random.default_rng(0).normal(3.0, 2.0, (4000, 5)).tolist()
    covered = sum(estimate.low <= 3.0 <= estimate.high for estimate in map(mean_estimate, draws))
    assert covered / len(draws) == pytest.approx(0.95, abs=0.012)


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


@given(st.integers(1, 2000).flatmap(lambda count: st.tuples(st.integers(0, count), st.just(count))))
def test_a_share_and_its_mirror_image_are_inside_0_and_1(case):
    hits, count = case
    estimate, mirrored = share_estimate(hits, count), share_estimate(count - hits, count)
    assert 0 <= estimate.low <= hits / count <= estimate.high <= 1
    assert estimate.low == pytest.approx(1 - mirrored.high, abs=1e-12)


@pytest.mark.parametrize("wrong", [(0, 0), (3, 2), (-1, 4)])
def test_what_is_no_share_is_refused(wrong):
    with pytest.raises(ValueError, match="no share"):
        share_estimate(*wrong)


def test_no_values_have_no_mean():
    with pytest.raises(ValueError, match="no values"):
        mean_estimate([])
