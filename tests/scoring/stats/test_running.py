"""Sums and quantiles of what is not kept, against those of what is."""

from __future__ import annotations

import math
import tracemalloc

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from adatracker_deploy.scoring.stats import running
from adatracker_deploy.scoring.stats.running import ACCURACY, LEAST, MOST, RunningQuantiles, RunningSum

SHARES = (0.0, 0.01, 0.5, 0.9, 0.99, 1.0)


def quantiles_of(values, shares=SHARES):
    quantiles = RunningQuantiles()
    for value in values:
        quantiles.add(value)
    return quantiles.quantiles(shares)


@pytest.fixture
def keeping_few(monkeypatch):
    monkeypatch.setattr(running, "KEPT", 3)


@given(st.lists(st.floats(-1e9, 1e9), max_size=100))
def test_a_short_sum_is_rounded_once(values):
    total = RunningSum()
    for value in values:
        total.add(value)
    assert (total.total(), total.count) == (math.fsum(values), len(values))


def test_a_long_sum_loses_nothing_that_matters():
    values = np.random.default_rng(3).uniform(-1, 1, 50_000).tolist()
    total = RunningSum()
    for value in values:
        total.add(value)
    assert total.total() == pytest.approx(math.fsum(values), abs=1e-12)
    assert total.count == 50_000


def test_ones_sum_up_to_their_number_however_many():
    total = RunningSum()
    for _ in range(20_000):
        total.add(1.0)
    assert total.total() == 20_000.0


@given(st.lists(st.floats(0, 1e9), min_size=1, max_size=50))
def test_quantiles_of_few_values_are_exact(values):
    assert quantiles_of(values) == tuple(np.quantile(values, SHARES))


@pytest.mark.usefixtures("keeping_few")
@pytest.mark.parametrize("count", [4, 6, 7, 40, 1000])
@pytest.mark.parametrize("spread", ["lognormal", "two modes", "one value"])
def test_quantiles_of_more_are_within_their_accuracy_and_the_greatest_is_exact(count, spread):
    random = np.random.default_rng(count)
    values = {
        "lognormal": random.lognormal(2, 2, count),
        "two modes": random.choice([0.05, 250.0], count),
        "one value": np.full(count, 17.3),
    }[spread]
    found = quantiles_of(values.tolist())
    assert found == pytest.approx(np.quantile(values, SHARES), rel=ACCURACY * 1.01, abs=LEAST)
    assert found[-1] == values.max()


@pytest.mark.usefixtures("keeping_few")
@given(st.lists(st.floats(LEAST, MOST), min_size=4, max_size=60), st.floats(0, 1))
def test_any_quantile_of_more_is_within_its_accuracy(values, share):
    (found,) = quantiles_of(values, (share,))
    assert found == pytest.approx(np.quantile(values, share), rel=ACCURACY * 1.01)


@pytest.mark.usefixtures("keeping_few")
def test_what_is_out_of_range_is_counted_at_its_end():
    least, middle, greatest = quantiles_of([0.0, -1e-5, 1e-9, 0.0, 4.0, 1e12, 1e12, 2e12], (0.0, 0.5, 1.0))
    assert least == pytest.approx(0.0, abs=2 * LEAST)
    assert middle == pytest.approx(2.0, abs=(LEAST + 4 * ACCURACY) / 2)  # half way from 0.0 to 4.0
    assert greatest == 2e12


@pytest.mark.usefixtures("keeping_few")
@pytest.mark.parametrize("times", [1, 5])
def test_what_is_not_finite_is_left_out(times):
    assert quantiles_of([math.nan, math.inf] * times) is None
    assert quantiles_of([math.nan, 2.0, math.inf, 2.0] * times, (0.5, 1.0)) == pytest.approx(
        (2.0, 2.0), rel=1e-3
    )


def test_nothing_has_no_quantiles():
    assert RunningQuantiles().quantiles(SHARES) is None


def test_memory_does_not_grow_with_their_number():
    quantiles, total = RunningQuantiles(), RunningSum()

    def take(count):
        for value in range(count):
            quantiles.add(float(value))
            total.add(float(value))
        quantiles.quantiles(SHARES)

    tracemalloc.start()
    try:
        take(2 * running.KEPT)
        before, _ = tracemalloc.get_traced_memory()
        take(10 * running.KEPT)
        after, _ = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert after - before < 2 * 8 * running.KEPT
