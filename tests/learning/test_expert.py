"""The expert is a ceiling worth imitating, on tuning seeds, and is not upset by actions that others made."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from adatracker_deploy.core.messages import Twist
from adatracker_deploy.learning.conditions import make_cell
from adatracker_deploy.learning.expert import Expert
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
