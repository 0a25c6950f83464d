"""The expert is a ceiling worth imitating, on tuning seeds, and is not upset by actions that others made."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from adatracker_deploy.core.messages import MaskClass, Twist
from adatracker_deploy.learning.conditions import make_cell
from adatracker_deploy.learning.expert import COAST_S, DEFAULT_GAINS, SEARCH_S, Expert, ExpertGains
from adatracker_deploy.learning.seeds import TUNING
from adatracker_deploy.learning.tracking import ACTION, Tracking
from adatracker_deploy.policy.base import to_twist

SHOWN = np.full((64, 64), MaskClass.TARGET, np.uint8)
BLANK = np.full((64, 64), MaskClass.BACKGROUND, np.uint8)
CORNERS = [(0.3, 0.5), (0.3, 3.0), (3.0, 1.0), (3.0, 3.0)]


def followed(spec, steps=300, gains=DEFAULT_GAINS):
    tracking = Tracking(spec, spec.task_settings(steps))
    expert, mask = Expert(tracking, gains), tracking.begin().mask
    ticks = []
    while not ticks or not ticks[-1].end:
        action = expert.act(mask)
        assert np.abs(action).max() <= 1.0
        ticks.append(tracking.step(action))
        mask = ticks[-1].observation.mask
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
        action = np.array([0.0, 1.0], np.float32) if step < 15 else expert.act(SHOWN)
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
    assert turned.act(SHOWN)[1] < straight.act(SHOWN)[1] - 0.5


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
            expert.act(SHOWN)
            tick = tracking.step(np.array([0.0, 0.3], np.float32))
            expert.executed(to_twist(np.array([0.0, 0.3]), ACTION, tracking.limits))
        return expert.act(SHOWN)[1] / tick.truth.bearing_rad

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
            action = expert.act(SHOWN)
            tick = tracking.step(action)
            expert.executed(to_twist(action, ACTION, tracking.limits))
        return abs(tick.truth.bearing_rad) / before

    assert left(0.1) < 0.1
    assert left(0.5) == pytest.approx(0.8**3, abs=0.1)  # a fifth of what is left each step


BELIEVES = ExpertGains(settling_s=0.2, lead=0.15, believes=True)


def blinded(spec, gains, blank_steps):
    """Stand still with the target in view, then be shown it no more; return the actions and the ticks."""
    tracking = Tracking(spec)
    tracking.begin()
    expert = Expert(tracking, gains)
    actions, ticks = [], []
    for step in range(5 + blank_steps):
        actions.append(expert.act(SHOWN if step < 5 else BLANK))
        ticks.append(tracking.step(np.zeros(2, np.float32)))
        expert.executed(Twist())
    return np.array(actions), ticks


def test_one_that_believes_acts_on_the_truth_as_long_as_the_mask_shows_the_target():
    spec = make_cell("clean", 1.0, 1.0, TUNING[9])
    gains = dataclasses.replace(BELIEVES, believes=False)
    assert np.array_equal(blinded(spec, BELIEVES, 0)[0], blinded(spec, gains, 0)[0])


def test_one_that_believes_lets_the_target_walk_on_for_a_while_and_then_turns_to_where_it_last_saw_it():
    """The target walks straight on, so the belief is right while it coasts, and knows nothing after that."""
    spec = dataclasses.replace(make_cell("clean", 1.0, 0.5, TUNING[9]), path="s_path", scene="parking_lot")
    blank = round(10 * SEARCH_S) + 10
    believed, ticks = blinded(spec, BELIEVES, blank)
    knowing, _ = blinded(spec, dataclasses.replace(BELIEVES, believes=False), blank)
    coasts = slice(5, 5 + round(10 * COAST_S))
    assert np.abs(believed[coasts] - knowing[coasts]).max() < 0.2
    searches = believed[6 + round(10 * SEARCH_S) :]
    assert np.all(searches[:, 0] == 0.0)
    assert np.all(np.abs(searches[:, 1]) == 1.0)
    last_sight = ticks[3].truth.bearing_rad
    assert abs(last_sight) > 1e-4
    assert np.all(searches[:, 1] == np.sign(last_sight))


def test_what_it_believes_depends_on_nothing_that_happens_in_a_gap():
    """Two worlds in which the target goes different ways while nobody sees it."""
    spec = make_cell("clean", 1.0, 1.0, TUNING[9])
    seen, other = (Tracking(dataclasses.replace(spec, path=path)) for path in ("random_walk", "still"))
    for tracking in (seen, other):
        tracking.begin()
    # Both have shown it once, where it stands at the start, so both believe that it stands.
    acts = []
    for tracking in (seen, other):
        expert = Expert(tracking, BELIEVES)
        told = [expert.act(SHOWN)]
        for _ in range(30):
            tracking.step(np.zeros(2, np.float32))
            expert.executed(Twist())
            told.append(expert.act(BLANK))
        acts.append(np.array(told))
    assert np.array_equal(acts[0], acts[1])


def test_at_the_next_sight_it_knows_the_place_at_once_and_turns_to_it():
    spec = make_cell("clean", 1.0, 1.0, TUNING[9])
    tracking = Tracking(spec)
    tracking.begin()
    expert = Expert(tracking, BELIEVES)
    for _ in range(40):
        expert.act(BLANK)
        tick = tracking.step(np.zeros(2, np.float32))
        expert.executed(Twist())
    action = expert.act(SHOWN)
    assert np.sign(action[1]) == np.sign(tick.truth.bearing_rad)
    assert abs(tick.truth.bearing_rad) > 0.05


def test_in_hard_one_that_believes_keeps_most_targets():
    ends = [
        followed(make_cell("hard", height, speed, TUNING[100]), gains=BELIEVES)[-1].end
        for height, speed in CORNERS
    ]
    assert ends.count("completed") >= 3
