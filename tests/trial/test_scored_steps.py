"""What is kept of a tick is what is scored of it, whole."""

from __future__ import annotations

import tracemalloc

import pytest
from hypothesis import given
from hypothesis import strategies as st

from adatracker_deploy.trial.scored_steps import ScoredSteps
from tests.trial.records import a_step, any_steps, scored

int64 = st.integers(-(2**63), 2**63 - 1)
records = any_steps(step=int64, t_ns=int64, missed_deadlines=int64)


@given(st.lists(records, max_size=5))
def test_what_is_kept_is_read_back_whole_even_nan_and_what_is_absent(ticks):
    kept = ScoredSteps()
    for tick in ticks:
        kept.append(tick)
    assert repr(list(kept)) == repr([scored(tick) for tick in ticks])  # repr: NaN is not equal to itself


def test_it_is_read_as_a_list_is():
    kept, ticks = ScoredSteps(), [scored(a_step(number)) for number in range(5)]
    for tick in ticks:
        kept.append(tick)
    assert (len(kept), kept[0], kept[-1]) == (5, ticks[0], ticks[-1])
    assert (kept[1:], kept[:2], kept[::-1]) == (ticks[1:], ticks[:2], ticks[::-1])
    with pytest.raises(IndexError):
        kept[5]


def test_an_hour_of_a_trial_fits_in_a_few_megabytes():
    kept, tick = ScoredSteps(), a_step(1)
    tracemalloc.start()
    try:
        for _ in range(2000):
            kept.append(tick)
        used, _ = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert used / 2000 < 200  # bytes a tick: 14 MB an hour
