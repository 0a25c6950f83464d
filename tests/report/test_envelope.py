"""A curve with fewer points hides no spike and no gap."""

from __future__ import annotations

import itertools
import math

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from adatracker_deploy.report.charts import envelope

curves = hnp.arrays(np.float64, st.integers(0, 400), elements=st.floats(-1e6, 1e6) | st.just(math.nan))
columns = st.integers(1, 60)


@given(curves, columns)
def test_there_are_few_points_in_order_from_the_first_to_the_last(values, count):
    kept = envelope(values, count)
    assert len(kept) <= 3 * count + 2
    assert (np.diff(kept) > 0).all()
    if len(values):
        assert (kept[0], kept[-1]) == (0, len(values) - 1)


@given(curves, columns)
def test_every_column_keeps_its_least_its_greatest_and_its_gap(values, count):
    kept = envelope(values, count)
    edges = np.linspace(0, len(values), count + 1).astype(int)
    for start, end in itertools.pairwise(edges):
        whole, shown = values[start:end], values[kept[(kept >= start) & (kept < end)]]
        if np.isfinite(whole).any():
            assert np.nanmin(shown) == np.nanmin(whole)
            assert np.nanmax(shown) == np.nanmax(whole)
        assert np.isnan(shown).any() == np.isnan(whole).any()


def test_a_short_curve_keeps_every_point():
    assert envelope(np.arange(30.0), 10).tolist() == list(range(30))


def test_one_spike_in_twelve_thousand_steps_is_there():
    values = np.zeros(12_000)
    values[7_777] = 1.0
    assert 7_777 in envelope(values, 600)
