"""Records as columns, by pencil."""

from __future__ import annotations

import math

import numpy as np
import pytest

from adatracker_deploy.core.messages import Box
from adatracker_deploy.report.columns import Interval, columns
from tests.trial.records import REFERENCE, a_step


def test_r_and_errors_are_against_the_first_box_and_a_lost_step_has_an_r_of_0_and_no_error():
    moved = Box(REFERENCE.cx + 0.3, REFERENCE.cy + 0.4, REFERENCE.w + 0.06, REFERENCE.h + 0.08)
    cols = columns([a_step(0), a_step(1, box=moved), a_step(2, box=None)])
    assert cols.reward == pytest.approx([1.0, 1 / 1.6, 0.0])
    assert cols.centre_error == pytest.approx([0.0, 0.5, math.nan], nan_ok=True)
    assert cols.size_error == pytest.approx([0.0, 0.1, math.nan], nan_ok=True)


def test_a_stretch_lasts_until_the_next_tick_begins_and_the_last_for_a_period():
    cols = columns([a_step(number, box=None if number in (1, 2, 5) else REFERENCE) for number in range(6)])
    assert [tuple(stretch) for stretch in cols.stretches(cols.lost)] == [
        pytest.approx((0.05, 0.15)),
        pytest.approx((0.25, 0.30)),
    ]
    assert cols.duration_s == pytest.approx(0.30)


def test_a_command_is_withheld_by_any_reason_but_the_limits_and_without_an_action():
    steps = [
        a_step(0, gate=()),
        a_step(1, gate=("envelope", "acceleration")),
        a_step(2, gate=("stale",)),
        a_step(3, gate=("a reason to come",)),
        a_step(4, gate=(), stale=True, box=None, action=()),
    ]
    cols = columns(steps)
    assert cols.stopped.tolist() == [False, False, True, True, True]
    assert cols.limited.tolist() == [False, True, False, False, False]


def test_a_stale_tick_is_neither_seen_nor_lost_and_has_no_r():
    cols = columns([a_step(0), a_step(1, stale=True, box=None, action=()), a_step(2, box=None)])
    assert cols.lost.tolist() == [False, False, True]
    assert cols.reward == pytest.approx([1.0, math.nan, 0.0], nan_ok=True)


def test_what_is_not_known_or_infinite_is_nan():
    cols = columns([a_step(0, velocity=None, battery=None, state_age_s=math.inf)])
    assert np.isnan([cols.measured["vx"][0], cols.battery[0], cols.link_age_s[0]]).all()


def test_a_skipped_slot_is_noted_at_the_tick_after_it():
    cols = columns([a_step(number, missed_deadlines=missed) for number, missed in enumerate((0, 2, 2, 3))])
    assert cols.missed.tolist() == [False, True, False, True]


def test_a_trial_of_a_single_tick_has_a_length():
    cols = columns([a_step(0)])
    assert cols.stretches(cols.limited) == [Interval(0.0, cols.duration_s)]
    assert cols.duration_s > 0


def test_a_trial_without_steps_has_no_columns():
    with pytest.raises(ValueError, match="no steps"):
        columns([])
