"""The delay of a network or a queue is estimated from any clock's stamps; drift is not taken for delay."""

from __future__ import annotations

import itertools

from hypothesis import given
from hypothesis import strategies as st

from adatracker_deploy.perception.transit import DRIFT_PPM, Transit

PERIOD_NS = 33_333_333
MS = 1_000_000
OFFSETS_NS = st.integers(-(10**20), 10**20)
"""Clocks may count from 1970, from boot, or from anything."""


def delays(pairs):
    """Return the delays estimated from (stamp, arrival) pairs, ns."""
    transit = Transit()
    return [transit.delay_ns(stamp_ns, arrived_ns) for stamp_ns, arrived_ns in pairs]


@given(OFFSETS_NS, st.lists(st.integers(0, 200 * MS), min_size=2, max_size=50))
def test_clocks_that_differ_by_anything_and_go_alike_show_no_delay(offset_ns, periods_ns):
    taken_ns = itertools.accumulate(periods_ns)
    assert set(delays((t_ns + offset_ns, t_ns) for t_ns in taken_ns)) == {0}


@given(OFFSETS_NS, st.integers(-200, 200), st.integers(0, 5 * MS))
def test_clocks_that_drift_as_quartz_does_show_no_delay_in_ten_minutes(offset_ns, ppm, way_ns):
    def stamp_ns(t_ns):
        return t_ns + t_ns * ppm // 1_000_000 + offset_ns

    taken_ns = range(0, 600 * 10**9, 10 * PERIOD_NS)
    assert max(delays((stamp_ns(t_ns), t_ns + way_ns) for t_ns in taken_ns)) <= 2


@given(OFFSETS_NS, st.lists(st.integers(0, 30 * MS), min_size=2, max_size=200))
def test_jitter_is_no_more_than_it_is(offset_ns, ways_ns):
    pairs = [(n * PERIOD_NS + offset_ns, n * PERIOD_NS + way_ns) for n, way_ns in enumerate(ways_ns)]
    found = delays(pairs)
    assert all(0 <= delay_ns <= way_ns for delay_ns, way_ns in zip(found, ways_ns, strict=True))


@given(
    OFFSETS_NS,
    st.integers(-200, 200),
    st.lists(st.integers(0, 10 * MS), min_size=30, max_size=60),
    st.lists(st.integers(0, 200 * MS), min_size=1, max_size=60),
)
def test_a_delay_that_grows_is_seen_as_it_grows(offset_ns, ppm, calm_ns, growth_ns):
    """The estimate may be short by the travel time of an undelayed picture and the allowed drift."""
    ways_ns = [*calm_ns, *itertools.accumulate(growth_ns, initial=calm_ns[-1])]
    taken_ns = [n * PERIOD_NS for n in range(len(ways_ns))]
    stamps_ns = [t_ns + t_ns * ppm // 1_000_000 + offset_ns for t_ns in taken_ns]
    arrived_ns = [t_ns + way_ns for t_ns, way_ns in zip(taken_ns, ways_ns, strict=True)]
    found = delays(zip(stamps_ns, arrived_ns, strict=True))
    drift_ns = arrived_ns[-1] * (DRIFT_PPM + 200) // 1_000_000 + 2
    for delay_ns, way_ns in list(zip(found, ways_ns, strict=True))[len(calm_ns) :]:
        assert way_ns - max(calm_ns) - drift_ns <= delay_ns <= way_ns + drift_ns


@given(OFFSETS_NS, st.lists(st.tuples(st.integers(1, 10**9), st.integers(0, 10**9)), max_size=60))
def test_the_time_at_which_pictures_were_taken_never_goes_backwards(offset_ns, steps):
    transit, stamp_ns, arrived_ns, before_ns = Transit(), offset_ns, 0, None
    for stamped_ns, came_ns in steps:
        stamp_ns, arrived_ns = stamp_ns + stamped_ns, arrived_ns + came_ns
        taken_ns = arrived_ns - transit.delay_ns(stamp_ns, arrived_ns)
        assert taken_ns <= arrived_ns
        assert before_ns is None or taken_ns >= before_ns
        before_ns = taken_ns


def test_a_queue_that_drains_shows_the_past_until_it_is_empty():
    """Two seconds of pictures wait, then come at once; the last is as fresh as any."""
    calm = [(n * PERIOD_NS, n * PERIOD_NS + 3 * MS) for n in range(30)]
    freed_ns = 90 * PERIOD_NS + 3 * MS
    burst = [(n * PERIOD_NS, freed_ns) for n in range(30, 91)]
    found = delays([*calm, *burst])[len(calm) :]
    assert found == sorted(found, reverse=True)
    assert 1.9e9 < found[0] < 2.1e9
    assert found[-1] == 0


def test_a_queue_that_stays_full_is_not_forgotten():
    pairs = [(n * PERIOD_NS, n * PERIOD_NS + (500 * MS if n > 30 else 0)) for n in range(9000)]
    assert delays(pairs)[-1] > 400 * MS  # after five minutes
