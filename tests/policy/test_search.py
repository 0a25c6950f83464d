"""The search: how a policy with a belief looks for a target that may have left its view."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from adatracker_deploy.policy import belief
from adatracker_deploy.policy.base import ActionAxis
from adatracker_deploy.policy.search import STRAYED_RAD, search_yaw, with_search

PERIOD_S = 0.1
STILL = np.zeros(2, np.float32)


def sight(bearing_rad):
    return np.float32([1, math.tan(bearing_rad), 0, 0.1, 0.4])


def swung(speed_rad_s, steps=80, most_rad=0.6):
    """Return the state after watching a target swing to and fro at a speed, from a body that stands."""
    state, bearing, way = belief.initial(), 0.0, 1.0
    for _ in range(steps):
        state = belief.advance(state, sight(bearing), STILL, PERIOD_S)
        way = -way if abs(bearing + way * speed_rad_s * PERIOD_S) > most_rad else way
        bearing += way * speed_rad_s * PERIOD_S
    return state


def gap_until_search(state, drive=STILL):
    """Return after how many seconds without a target it turns, and which way; infinity: never in 5 s."""
    for step in range(50):
        yaw = float(search_yaw(state))
        if yaw:
            return step * PERIOD_S, yaw
        state = belief.advance(state, np.zeros(5, np.float32), drive, PERIOD_S)
    return math.inf, 0.0


def test_whoever_was_never_seen_is_not_searched_for():
    assert gap_until_search(belief.initial()) == (math.inf, 0.0)


def test_a_fast_target_is_searched_for_soon_and_a_slow_one_is_waited_for():
    fast, _ = gap_until_search(swung(1.2))
    slow, _ = gap_until_search(swung(0.3))
    assert 1.0 <= fast <= 2.5
    assert slow >= 4.0


@pytest.mark.parametrize(("bearing", "side"), [(0.5, 1.0), (-0.5, -1.0)])
@pytest.mark.parametrize("drive", [STILL, np.float32([1, -1]), np.float32([0, 1])])
def test_it_turns_to_the_side_of_the_last_sight_whatever_was_commanded_since(bearing, side, drive):
    last = belief.advance(swung(1.2), sight(bearing), STILL, PERIOD_S)
    assert gap_until_search(last, drive)[1] == side


def test_it_goes_on_until_the_target_is_seen():
    state = belief.advance(swung(1.2), sight(0.5), STILL, PERIOD_S)
    turning = np.float32([0, 1])
    for _ in range(70):
        state = belief.advance(state, np.zeros(5, np.float32), turning, PERIOD_S)
    assert search_yaw(state) == 1.0
    assert search_yaw(belief.advance(state, sight(-0.5), turning, PERIOD_S)) == 0.0


def test_a_search_is_written_in_the_actions_order_and_signs():
    action = (ActionAxis(axis="yaw", sign=-1), ActionAxis(axis="lateral"), ActionAxis(axis="forward"))
    own = np.full((2, 3), 0.25, np.float32)
    assert with_search(own, np.float32([1, 0]), action).tolist() == [[-1, 0, 0], [0.25, 0.25, 0.25]]


def test_a_search_does_not_hide_a_network_that_answers_no_number():
    action = (ActionAxis(axis="forward"), ActionAxis(axis="yaw"))
    found = with_search(np.float32([[np.nan, 0.5], [0.5, np.inf]]), np.float32([1, 1]), action)
    assert np.isfinite(found).tolist() == [[False, True], [True, False]]


@settings(max_examples=30)
@given(seed=st.integers(0, 1 << 32))
def test_it_never_begins_while_the_target_is_seen_or_before_it_can_have_strayed(seed):
    rng = np.random.default_rng(seed)
    state = belief.initial(4)
    for _ in range(60):
        seen = rng.random(4) < 0.3
        now = np.where(seen[:, None], np.stack([sight(b) for b in rng.uniform(-0.7, 0.7, 4)]), np.float32(0))
        state = belief.advance(state, now, rng.uniform(-1, 1, (4, 2)).astype(np.float32), PERIOD_S)
        yaw, columns = search_yaw(state), dict(zip(belief.STATE, state.T, strict=True))
        assert set(yaw.tolist()) <= {-1.0, 0.0, 1.0}
        assert yaw.dtype == np.float32
        assert not yaw[seen].any()
        assert (columns["gap_s"] * columns["usual_rad_s"])[yaw != 0].min(initial=STRAYED_RAD) >= STRAYED_RAD
