"""The belief: what a policy is told about a target that it does not see."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from adatracker_deploy.core.messages import MaskClass
from adatracker_deploy.policy import belief
from adatracker_deploy.policy.base import ActionAxis
from adatracker_deploy.policy.drawing import MaskPainter
from adatracker_deploy.policy.past import over_time
from tests.policy import tiny

PERIOD_S = 0.1
STILL, LEFT = np.float32([0, 0]), np.float32([0, 1])


def picture(left=28, width=8, top=20, height=30):
    shown = np.zeros((64, 64), bool)
    shown[top : top + height, left : left + width] = True
    return shown


def after(*steps):
    """Return the state, by name, after (sight, drive) steps; a sight of None shows nothing."""
    state = belief.initial()
    for shown, drive in steps:
        sight = belief.sight_of(np.zeros((64, 64), bool) if shown is None else shown)
        state = belief.advance(state, sight, drive, PERIOD_S)
    return dict(zip(belief.STATE, state, strict=True)), dict(
        zip(belief.COLUMNS, belief.told(state), strict=True)
    )


def test_a_bar_is_as_wide_and_as_high_as_it_is_and_where_it_is():
    sight = dict(
        zip(belief.SIGHT, belief.sight_of(picture(left=0, width=16, top=48, height=16)), strict=True)
    )
    assert sight == pytest.approx({"seen": 1, "left": 0.75, "up": -0.75, "width": 0.25, "height": 0.25})


def test_a_false_blob_moves_the_sight_less_than_a_box():
    spoilt = picture()
    spoilt[2:5, 60:63] = True
    clean, moved = belief.sight_of(picture()), belief.sight_of(spoilt)
    assert abs(moved[1] - clean[1]) < 0.05  # the box's centre would move by 0.53


def test_before_anything_was_seen_the_gap_is_the_longest():
    _, told = after((None, STILL))
    assert (told["seen"], told["gap"], told["bearing_sin"], told["bearing_cos"]) == pytest.approx(
        (0, 1, 0, 1)
    )


def test_across_a_gap_the_last_sight_stays_and_the_drive_adds_up():
    forward = np.float32([0.5, -1])
    state, told = after((picture(left=0), STILL), *[(None, forward)] * 4)
    assert state["gap_s"] == pytest.approx(0.4)
    assert state["left"] == pytest.approx(1 - 8 / 64)
    assert (state["driven_s"], state["turned_s"]) == pytest.approx((0.2, -0.4))
    assert told["seen"] == 0


def test_a_sight_ends_the_gap():
    state, _ = after((picture(), STILL), *[(None, LEFT)] * 4, (picture(left=40), LEFT))
    assert (state["gap_s"], state["driven_s"], state["turned_s"], state["seen"]) == (0, 0, 0, 1)


def test_turning_away_moves_the_expected_bearing_the_other_way():
    _, told = after((picture(), STILL), *[(None, LEFT)] * 6)
    expected = math.atan2(told["bearing_sin"], told["bearing_cos"])
    assert expected == pytest.approx(-0.6 * math.radians(120), abs=0.02)


def test_a_body_that_turns_with_the_target_believes_it_to_go_on():
    """A target at 60 deg/s that is kept in the middle is expected there after a gap of equal turning."""
    turn = np.float32([0, 0.5])
    _, told = after((picture(), STILL), *[(picture(), turn)] * 30, *[(None, turn)] * 8)
    assert told["pace"] == pytest.approx(math.radians(60) / 3, rel=0.05)
    assert math.atan2(told["bearing_sin"], told["bearing_cos"]) == pytest.approx(0, abs=0.1)


def test_a_long_gap_says_nothing_of_the_pace_and_ends():
    state, told = after((picture(), STILL), *[(None, STILL)] * 90, (picture(left=50), STILL))
    assert state["pace_rad_s"] == 0
    _, told = after((picture(), STILL), *[(None, LEFT)] * 90)
    assert told["gap"] == pytest.approx(1)


def beliefs_of(sights, drives):
    return over_time(sights, drives, believes=True, responds=False, period_s=PERIOD_S).belief


@settings(max_examples=30)
@given(seed=st.integers(0, 1 << 32))
def test_many_at_once_are_told_what_each_is_alone_and_nothing_leaves_its_range(seed):
    rng = np.random.default_rng(seed)
    shown = (rng.random((60, 3, 16, 16)) < 0.02) & (rng.random((60, 3, 1, 1)) < 0.3)
    drives = rng.uniform(-1, 1, (60, 3, 2)).astype(np.float32)
    together = beliefs_of(belief.sight_of(shown), drives)
    alone = beliefs_of(belief.sight_of(shown[:, 1]), drives[:, 1])
    np.testing.assert_allclose(together[:, 1], alone, atol=1e-5)
    assert np.abs(together).max() <= 2.0
    assert together.dtype == np.float32


def test_a_drive_is_read_in_the_actions_order_and_signs():
    action = (ActionAxis(axis="yaw", sign=-1), ActionAxis(axis="forward"))
    assert belief.drive_of(np.float32([0.25, -0.5]), action).tolist() == [-0.5, -0.25]


def test_the_targets_pixels_are_found_in_what_the_network_is_shown():
    mask = np.where(picture(left=16, width=32, height=44), MaskClass.TARGET, MaskClass.BACKGROUND).astype(
        np.uint8
    )
    mask[:10] = MaskClass.PERSON
    shown = MaskPainter(tiny.MASK, seed=3).paint(mask)
    found = belief.target_pixels(shown, tiny.MASK)
    # From 64 by 16 to 8 pixels a side; what is mixed at the edges does not count.
    assert found[3:, 3:5].all()
    assert not found[:2].any()
