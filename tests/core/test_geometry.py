"""Poses compose as rotations do, and boxes are as tight as their masks."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from adatracker_deploy.core.geometry import Pose, Quaternion, wrap_angle
from adatracker_deploy.core.messages import Box, MaskClass
from adatracker_deploy.sim.anchor import Anchor

lengths = st.floats(-50, 50)
angles = st.floats(-3.1, 3.1)
shares = st.floats(0.01, 1.0)
boxes = st.builds(Box, shares, shares, shares, shares)
poses = st.builds(Pose, lengths, lengths, lengths, angles, st.floats(-1.5, 1.5), angles)


@given(st.floats(-100, 100))
def test_a_wrapped_angle_points_the_same_way(angle):
    wrapped = wrap_angle(angle)
    assert -math.pi < wrapped <= math.pi
    assert math.cos(wrapped) == pytest.approx(math.cos(angle), abs=1e-9)
    assert math.sin(wrapped) == pytest.approx(math.sin(angle), abs=1e-9)


@given(poses, poses)
def test_composing_poses_composes_their_rotations_and_places(a, b):
    made = a @ b
    np.testing.assert_allclose(made.rotation(), a.rotation() @ b.rotation(), atol=1e-7)
    np.testing.assert_allclose(
        made.translation(), a.rotation() @ b.translation() + a.translation(), atol=1e-7
    )


@given(angles, st.floats(-1.5, 1.5), angles)
def test_a_quaternion_turns_as_its_pose_does(roll, pitch, yaw):
    w, x, y, z = Quaternion.of(roll, pitch, yaw)
    axis = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    turned = np.eye(3) + 2 * w * axis + 2 * axis @ axis  # Rodrigues' formula, by quaternions
    np.testing.assert_allclose(turned, Pose(roll=roll, pitch=pitch, yaw=yaw).rotation(), atol=1e-9)


@given(angles, st.floats(-1.5, 1.5), angles)
def test_a_quaternion_and_its_opposite_give_back_the_angles(roll, pitch, yaw):
    quaternion = Quaternion.of(roll, pitch, yaw)
    for same in (quaternion, Quaternion(*(-part for part in quaternion))):
        assert same.roll_pitch_yaw() == pytest.approx((roll, pitch, yaw), abs=1e-6)


@pytest.mark.parametrize("length", [0.0, 0.99, 1.01, math.nan, math.inf])
def test_a_quaternion_that_is_not_of_unit_length_is_refused(length):
    with pytest.raises(ValueError, match="not of unit length"):
        Quaternion(length, 0.0, 0.0, 0.0).roll_pitch_yaw()


def test_a_positive_pitch_looks_down_and_a_positive_bearing_is_left():
    assert Pose(pitch=0.3).rotation()[2, 0] < 0
    assert Pose(yaw=math.pi / 2).bearing_to(-1.0, 0.0) == pytest.approx(math.pi / 2)


@given(
    st.builds(Pose, lengths, lengths, lengths, yaw=angles),
    st.builds(Pose, lengths, lengths, lengths, yaw=angles),
    lengths,
)
def test_an_anchor_takes_the_start_to_the_start_and_keeps_shapes(robot, world, ahead):
    anchor = Anchor.between(robot, world)
    start = anchor.to_world(robot)
    assert (start.x, start.y) == pytest.approx((world.x, world.y), abs=1e-6)
    assert start.z == pytest.approx(world.z + robot.z)
    moved, expected = anchor.to_world(robot @ Pose(x=ahead, y=1.0)), world @ Pose(x=ahead, y=1.0)
    assert (moved.x, moved.y) == pytest.approx((expected.x, expected.y), abs=1e-6)


def test_a_box_is_tight_around_its_class():
    mask = np.zeros((10, 20), np.uint8)
    mask[2:5, 4:8] = MaskClass.TARGET
    mask[0, 0] = MaskClass.PERSON
    box = Box.of_mask(mask)
    assert box is not None
    assert (box.cx, box.cy, box.w, box.h) == pytest.approx((0.3, 0.35, 0.2, 0.3))
    assert Box.of_mask(np.zeros((4, 4), np.uint8)) is None


@given(boxes, boxes)
def test_the_overlap_of_boxes_is_a_share(a, b):
    assert 0.0 <= a.iou(b) <= 1.0
    assert a.iou(b) == pytest.approx(b.iou(a))
    assert a.iou(a) == pytest.approx(1.0)


def test_the_overlap_of_a_box_with_its_half():
    whole = Box(0.5, 0.5, 0.4, 0.2)
    assert whole.iou(Box(0.4, 0.5, 0.2, 0.2)) == pytest.approx(0.5)
    assert whole.iou(Box(0.9, 0.9, 0.1, 0.1)) == 0.0
