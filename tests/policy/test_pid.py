"""The baseline steers the box back to where it first was, and does nothing rash when the box lies."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from adatracker_deploy.core.messages import Box, Observation
from adatracker_deploy.policy.pid import FIRST_DISTANCE_M, PidPolicy, bearing_of, distance_of

FIRST = Box(0.5, 0.5, 0.12, 0.4)
"""A whole person in the middle of the picture."""
RATE_HZ = 20.0

fractions = st.floats(0.0, 1.0)
boxes = st.none() | st.builds(Box, fractions, fractions, fractions, fractions)


def follow(policy, boxes, start_tick=1):
    """Show one box a tick; return the actions (T, 2): forward, yaw."""
    return np.array([policy.act(at_tick(tick, box)).values for tick, box in enumerate(boxes, start_tick)])


def at_tick(tick, box):
    mask, t_ns = np.zeros((1, 1), np.uint8), round(tick * 1e9 / RATE_HZ)
    return Observation(mask=mask, box=box, confidence=1.0, t_ns=t_ns, seq=tick)


def after(*boxes, ticks=10):
    """Return the last action after the first box and then each of `boxes` for `ticks` ticks."""
    return follow(PidPolicy(), [FIRST, *(box for box in boxes for _ in range(ticks))])[-1]


def seen_at(distance_m, cx=0.5, visible=1.0):
    """Return the box of a person at a distance of whom the upper part, `visible`, shows."""
    ratio = FIRST_DISTANCE_M / distance_m
    height = FIRST.h * ratio
    return Box(cx, FIRST.cy - height * (1 - visible) / 2, FIRST.w * ratio, height * visible)


def test_at_the_first_picture_it_stands_still():
    assert not follow(PidPolicy(), [FIRST] * 50).any()


@pytest.mark.parametrize(("cx", "side"), [(0.3, 1), (0.7, -1)])
def test_it_turns_towards_the_box_left_being_positive(cx, side):
    forward, yaw = after(seen_at(FIRST_DISTANCE_M, cx))
    assert yaw * side > 0.2
    assert abs(forward) < 0.05


@pytest.mark.parametrize(("distance_m", "direction"), [(3.5, 1), (1.8, -1)])
def test_it_goes_forward_when_the_box_shrinks_and_back_when_it_grows(distance_m, direction):
    forward, yaw = after(seen_at(distance_m))
    assert forward * direction > 0.3
    assert yaw == 0


def test_it_turns_before_it_drives_when_the_target_is_far_aside():
    straight, _ = after(seen_at(4.0))
    aside, yaw = after(seen_at(4.0, cx=0.05))
    assert 0 <= aside < straight / 2
    assert yaw > 0.9


def test_a_person_half_hidden_by_a_wall_does_not_make_it_rush():
    assert distance_of(seen_at(FIRST_DISTANCE_M, visible=0.3), FIRST) <= 1.4 * FIRST_DISTANCE_M
    hidden, far = after(seen_at(2.0, visible=0.4)), after(seen_at(5.0))
    assert hidden[0] < 0.5 * far[0]


@pytest.mark.parametrize("distance_m", [1.5, 2.5, 4.0, 6.0])
def test_distance_and_bearing_are_those_of_a_pinhole_camera_of_90_degrees(distance_m):
    box = seen_at(distance_m, cx=0.25)
    assert distance_of(box, FIRST) == pytest.approx(distance_m)
    assert bearing_of(box) == pytest.approx(np.arctan(0.5))


def test_a_box_cut_by_the_border_is_judged_by_its_top_edge_and_width():
    first = Box(0.5, 0.65, 0.2, 0.7)  # the feet are out of the picture
    nearer = Box(0.5, 0.5, 0.4, 1.0)
    assert distance_of(first, first) == pytest.approx(FIRST_DISTANCE_M)
    assert distance_of(nearer, first) < FIRST_DISTANCE_M


def test_until_the_target_was_seen_once_it_does_not_move():
    assert not follow(PidPolicy(), [None] * 40).any()


@pytest.mark.parametrize(("cx", "side"), [(0.1, 1), (0.9, -1)])
def test_when_the_target_is_gone_it_fades_out_then_searches_towards_the_last_side(cx, side):
    policy = PidPolicy()
    seen = follow(policy, [FIRST, *[seen_at(4.0, cx)] * 10])
    gone = follow(policy, [None] * 40, start_tick=12)
    fading = np.abs(gone[:7])
    assert (fading[0] < np.abs(seen[-1])).all()
    assert (np.diff(fading, axis=0) <= 0).all()
    forward, yaw = gone[-1]
    assert forward == 0
    assert yaw * side == pytest.approx(0.6)
    assert [policy.act(at_tick(60 + tick, box)).searching for tick, box in enumerate((None, FIRST))] == [1, 0]


def test_a_reset_forgets_the_first_box():
    policy = PidPolicy()
    follow(policy, [FIRST, *[seen_at(5.0)] * 20])
    policy.reset(seed=4)
    assert not follow(policy, [seen_at(5.0)] * 20).any()


@given(st.lists(boxes, max_size=60))
def test_whatever_boxes_come_the_action_is_finite_and_within_one(sequence):
    actions = follow(PidPolicy(), sequence)
    assert np.isfinite(actions).all()
    assert (np.abs(actions) <= 1).all()


aside = st.floats(0.0, 0.49) | st.floats(0.51, 1.0)


@given(st.lists(st.none() | st.builds(Box, aside, fractions, fractions, fractions), min_size=1, max_size=40))
def test_a_mirrored_world_is_answered_with_mirrored_turns(sequence):
    mirrored = [box and Box(1 - box.cx, box.cy, box.w, box.h) for box in sequence]
    actions, answers = follow(PidPolicy(), sequence), follow(PidPolicy(), mirrored)
    np.testing.assert_allclose(actions * [1, -1], answers, atol=1e-5)
