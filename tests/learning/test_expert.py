"""The expert is a ceiling worth imitating, on tuning seeds, and is not upset by actions that others made."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from adatracker_deploy.core.messages import Twist
from adatracker_deploy.learning.conditions import make_cell
from adatracker_deploy.learning.expert import Expert, ExpertGains
from adatracker_deploy.learning.seeds import TUNING
from adatracker_deploy.learning.tracking import ACTION, Tracking
from adatracker_deploy.policy.base import to_twist

CORNERS = [(0.3, 0.5), (0.3, 3.0), (3.0, 1.0), (3.0, 3.0)]


def followed(spec, steps=300):
    tracking = Tracking(spec, spec.task_settings(steps))
    tracking.begin()
    expert = Expert(tracking)
    ticks = []
    while not ticks or not ticks[-1].end:
        action = expert.act()
        assert np.abs(action).max() <= 1.0
        ticks.append(tracking.step(action))
        expert.executed(to_twist(action, ACTION, tracking.limits))
    return ticks


@pytest.mark.parametrize(("height", "speed"), CORNERS)
def test_in_the_clean_world_it_loses_almost_nothing(height, speed):
    ticks = followed(make_cell("clean", height, speed, TUNING[100]))
    assert ticks[-1].end == "completed"
    assert np.mean([tick.reward for tick in ticks]) > 0.97


@pytest.mark.parametrize(("height", "speed"), CORNERS)
def test_in_the_field_it_makes_up_for_lag_and_delay(height, speed):
    ticks = followed(make_cell("field", height, speed, TUNING[100]))
    assert ticks[-1].end == "completed"
    assert np.mean([tick.reward for tick in ticks]) > 0.85


def test_it_turns_towards_a_target_behind_it_and_gets_back_to_it():
    spec = dataclasses.replace(make_cell("clean", 1.0, 1.0, TUNING[7]), path="still")
    tracking = Tracking(spec)
    tracking.begin()
    expert = Expert(tracking)
    for step in range(80):
        action = np.array([0.0, 1.0], np.float32) if step < 15 else expert.act()
        tick = tracking.step(action)
        expert.executed(to_twist(action, ACTION, tracking.limits))
    assert abs(tick.truth.bearing_rad) < 0.05
    assert tick.truth.distance_m == pytest.approx(2.5, abs=0.1)


def test_it_takes_into_account_what_is_still_under_way():
    spec = make_cell("clean", 1.0, 1.0, TUNING[8])
    late = dataclasses.replace(
        spec, embodiment=dataclasses.replace(spec.embodiment, delay_s=0.3), path="still"
    )
    tracking = Tracking(late)
    tracking.begin()
    turned, straight = Expert(tracking), Expert(tracking)
    for _ in range(3):
        turned.executed(Twist(yaw_rate=1.0))
        straight.executed(Twist())
    assert turned.act()[1] < straight.act()[1] - 0.5


def test_without_lead_a_body_that_lags_is_told_no_more_than_one_that_obeys_at_once():
    """With it, an error about the lag is one about the gain, and a clone turns to and fro."""
    spec = dataclasses.replace(make_cell("clean", 1.0, 1.0, TUNING[8]), path="still")

    def turn(lag_s, lead):
        """The action 0.3 s after the body began to turn away."""
        body = dataclasses.replace(spec.embodiment, lag_s=lag_s, yaw_rate_rad_s=2.0)
        tracking = Tracking(dataclasses.replace(spec, embodiment=body))
        tracking.begin()
        gains = ExpertGains(settling_s=0.5, lags=0.0, lead=lead)
        expert = Expert(tracking, gains)
        for _ in range(3):
            expert.act()
            tick = tracking.step(np.array([0.0, 0.3], np.float32))
            expert.executed(to_twist(np.array([0.0, 0.3]), ACTION, tracking.limits))
        return expert.act()[1] / tick.truth.bearing_rad

    assert turn(0.4, lead=0.0) == pytest.approx(turn(0.0, lead=0.0), rel=0.1)
    assert abs(turn(0.4, lead=0.7)) > 2 * abs(turn(0.0, lead=0.7))


def test_it_settles_in_the_time_that_it_is_given():
    spec = dataclasses.replace(make_cell("clean", 1.0, 1.0, TUNING[8]), path="still")

    def left(settling_s):
        """The share of the bearing that is left after 0.3 s."""
        tracking = Tracking(spec)
        tracking.begin()
        for _ in range(3):
            before = abs(tracking.step(np.array([0.0, 0.5], np.float32)).truth.bearing_rad)
        expert = Expert(tracking, ExpertGains(settling_s=settling_s))
        for _ in range(3):
            action = expert.act()
            tick = tracking.step(action)
            expert.executed(to_twist(action, ACTION, tracking.limits))
        return abs(tick.truth.bearing_rad) / before

    assert left(0.1) < 0.1
    assert left(0.5) == pytest.approx(0.8**3, abs=0.1)  # a fifth of what is left each step
