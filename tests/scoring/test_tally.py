"""A trial summed up as it runs keeps none of its ticks."""

from __future__ import annotations

import tracemalloc
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from adatracker_deploy.scoring.metrics import Rules
from adatracker_deploy.scoring.tally import Tally
from tests.trial.records import REFERENCE, TICK_NS, a_step, scored

ABOUT = {
    "platform": "drone",
    "policy": "pid",
    "outcome": "completed",
    "reason": "",
    "steps": 100,
    "stop_s": None,
    "trial": Path("one"),
}


def test_what_is_asked_for_on_the_way_is_of_the_ticks_so_far():
    tally = Tally(a_step(step) for step in range(11))
    first = tally.summary(**ABOUT)
    tally.add(a_step(11, box=None, missed_deadlines=3))
    then = tally.summary(**ABOUT)
    assert (first["el"], first["mr"], first["missed_deadlines"]) == (10, 1.0, 0)
    assert (then["el"], then["mr"], then["missed_deadlines"]) == (11, pytest.approx(10 / 11), 3)
    assert then["seconds"] == pytest.approx(11 * TICK_NS / 1e9)


@given(st.lists(st.none() | st.just(REFERENCE), max_size=40), st.integers(1, 12))
def test_a_run_and_its_log_come_to_the_same(seen, max_lost_steps):
    rules = Rules(max_lost_steps=max_lost_steps)
    ticks = [a_step(step, box=box) for step, box in enumerate(seen)]
    assert Tally(ticks, rules).summary(**ABOUT) == Tally(map(scored, ticks), rules).summary(**ABOUT)


@given(st.lists(st.none() | st.just(REFERENCE), min_size=1, max_size=60), st.integers(1, 12))
def test_ticks_after_the_last_lost_one_change_nothing_but_that_it_was_lost(seen, max_lost_steps):
    rules = Rules(max_lost_steps=max_lost_steps)
    ticks = [a_step(step, box=box) for step, box in enumerate([*seen, *[None] * max_lost_steps])]
    more = [a_step(step, missed_deadlines=9) for step in range(len(ticks), len(ticks) + 5)]
    ended = Tally(ticks, rules).summary(**ABOUT)
    assert Tally(ticks + more, rules).summary(**ABOUT) == ended
    assert ended["outcome"] == "lost"


def test_an_end_that_had_another_reason_keeps_it_where_the_rules_end_no_sooner():
    ticks = [a_step(step, box=None) for step in range(50)]
    ended = ABOUT | {"outcome": "safety_stop", "reason": "battery"}
    assert Tally(ticks).summary(**ended)["reason"] == "battery"
    assert Tally([*ticks, a_step(50)]).summary(**ended)["outcome"] == "lost"


def test_an_hour_takes_no_more_memory_than_ten_minutes():
    tally, tick = Tally(), a_step(1)

    def go_on(ticks):
        for _ in range(ticks):
            tally.add(tick)

    tracemalloc.start()
    try:
        go_on(12_000)
        before, _ = tracemalloc.get_traced_memory()
        go_on(60_000)
        after, _ = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert after - before < 500_000  # bytes; a tick as it was once kept had 146


def timing(steps):
    found = Tally(steps).summary(**ABOUT)
    assert found["counted"] == found["timing_kept"]
    return found["timing_kept"]


def test_a_trial_keeps_its_timing_while_a_tenth_of_its_slots_go_by_unused_at_most():
    def missed(number):
        return [a_step(step, missed_deadlines=number * (step > 5)) for step in range(90)]

    def stale(number):
        return [a_step(step, stale=10 <= step < 10 + number) for step in range(100)]

    assert timing(missed(10))
    assert not timing(missed(11))
    assert timing(stale(10))
    assert not timing(stale(11))


def test_a_camera_that_fell_silent_and_so_ended_the_trial_is_its_end_and_not_its_timing():
    assert timing([a_step(step, stale=step >= 60) for step in range(100)])
    assert not timing([a_step(step, stale=60 <= step < 99) for step in range(100)])


def test_the_share_of_stale_ticks_is_said():
    found = Tally([a_step(0), a_step(1), a_step(2, stale=True, box=None), a_step(3)]).summary(**ABOUT)
    assert (found["stale"], found["visibility"], found["mr"]) == (0.25, 1.0, 1.0)
