"""The rate is kept at absolute deadlines, and a missed slot is skipped, never replayed."""

from __future__ import annotations

import itertools

import pytest
from hypothesis import given
from hypothesis import strategies as st

from adatracker_deploy.core.clock import FakeClock, MonotonicClock
from adatracker_deploy.runtime.pacer import Pacer


def test_slots_do_not_drift_however_long_the_work_takes():
    clock = FakeClock(t_ns=0)
    pacer = Pacer(clock, rate_hz=30.0)
    for k in range(1000):
        tick = pacer.wait()
        assert tick.t_ns == round(k * 1e9 / 30)
        clock.advance(0.02)
    assert pacer.missed == 0


@given(st.lists(st.floats(0.0, 0.5), max_size=50))
def test_two_ticks_are_never_closer_than_half_a_period_and_every_slot_is_accounted_for(works):
    clock = FakeClock(t_ns=0)
    pacer = Pacer(clock, rate_hz=20.0)
    times = [pacer.wait().t_ns]
    for work_s in works:
        clock.advance(work_s)
        tick = pacer.wait()
        assert tick.lateness_s <= 0.025 + 1e-9
        times.append(tick.t_ns)
    gaps = [b - a for a, b in itertools.pairwise(times)]
    assert all(gap >= 25e6 - 1 for gap in gaps)
    assert len(times) + pacer.missed == round(times[-1] / 50e6) + 1


def test_a_long_stall_skips_its_slots_at_once():
    clock = FakeClock(t_ns=0)
    pacer = Pacer(clock, rate_hz=20.0)
    pacer.wait()
    clock.advance(1.01)
    tick = pacer.wait()
    assert tick.skipped == 19
    assert tick.lateness_s == pytest.approx(0.01)


class Late(FakeClock):
    """A machine that always wakes a sleeper when the slot is more than half over."""

    def sleep_until(self, t_ns):
        super().sleep_until(t_ns + 30_000_000)


def test_a_sleeper_that_is_always_woken_too_late_is_told_so_when_patience_ends():
    pacer = Pacer(Late(t_ns=0), rate_hz=20.0)
    tick = pacer.wait(patience=3)
    assert tick.skipped == pacer.missed == 3


def test_a_scaled_clock_runs_at_its_speed_and_its_copies_agree():
    clock = MonotonicClock(speed=5.0)
    copy = MonotonicClock(clock.speed, clock.epoch_ns)
    first = clock.now_ns()
    clock.sleep_until(first + 100_000_000)
    assert copy.now_ns() - first >= 100_000_000
