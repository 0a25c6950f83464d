"""A trial summed up as it runs keeps none of its ticks."""

from __future__ import annotations

import tracemalloc
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from adatracker_deploy.trial.metrics import Rules
from adatracker_deploy.trial.tally import Tally
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
