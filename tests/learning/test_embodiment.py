"""A body does what its embodiment says: camera, limits, lag, delay, gait and hover."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.core.geometry import Pose
from adatracker_deploy.core.messages import Twist
from adatracker_deploy.learning import embodiment as module
from adatracker_deploy.learning.conditions import make_cell
from adatracker_deploy.learning.embodiment import Embodiment
from adatracker_deploy.learning.seeds import TUNING
from adatracker_deploy.learning.tracking import Tracking
from adatracker_deploy.learning.view import pitch_in_view_deg, vertical_fov_deg

DT_S = 0.1


def standing(**chosen):
    body = Embodiment(**chosen).body()
    body.reset(Pose(), 0)
    return body


@given(height=st.floats(0.1, 4), pitch=st.floats(-30, 45))
def test_the_camera_is_at_its_height_and_looks_down_by_its_pitch(height, pitch):
    camera = standing(height_m=height, pitch_deg=pitch).camera_pose
    assert camera.z == pytest.approx(height)
    assert math.degrees(camera.pitch) == pytest.approx(pitch)


def test_a_body_goes_no_faster_than_its_limits():
    body = standing(forward_m_s=0.8, backward_m_s=0.4, yaw_rate_rad_s=1.0)
    body.step(Twist(vx=9.0, yaw_rate=9.0), DT_S)
    assert (body.velocity.vx, body.velocity.yaw_rate) == (0.8, 1.0)
    body.step(Twist(vx=-9.0), DT_S)
    assert body.velocity.vx == -0.4


def test_a_delayed_body_stands_until_the_delay_is_over():
    body = standing(delay_s=0.2)
    speeds = []
    for _ in range(4):
        body.step(Twist(vx=1.0), DT_S)
        speeds.append(body.velocity.vx)
    assert speeds == [0.0, 0.0, 1.0, 1.0]


def test_a_lagging_body_has_63_percent_of_its_speed_after_its_time_constant():
    body = standing(lag_s=0.5)
    for _ in range(5):
        body.step(Twist(vx=1.0), DT_S)
    assert body.velocity.vx == pytest.approx(1 - math.exp(-1))


def test_the_limits_are_what_an_action_of_one_means():
    limits = Embodiment(forward_m_s=2.0, backward_m_s=1.0, yaw_rate_rad_s=1.5).limits()
    assert (limits.forward_m_s, limits.backward_m_s, limits.yaw_rate_rad_s) == (2.0, 1.0, 1.5)


def test_a_walking_quadruped_shakes_its_camera_and_a_standing_one_does_not():
    body = standing(kind="quadruped", height_m=0.4)
    assert body.camera_pose == Pose(z=0.4)
    heights, pitches = [], []
    for _ in range(50):
        body.step(Twist(vx=1.0), DT_S)
        heights.append(body.camera_pose.z)
        pitches.append(math.degrees(body.camera_pose.pitch))
    assert 0.01 < np.ptp(heights) < 0.05
    assert 1.0 < np.ptp(pitches) < 5.0
    assert body.pose.z == 0.0


def test_a_drone_hovers_at_its_cameras_height_and_keeps_it_while_it_flies():
    body = Embodiment(kind="drone", height_m=2.0, forward_m_s=2.0).body()
    body.reset(Pose(x=3.0, yaw=0.5), 1)
    for step in range(60):
        body.step(Twist(vx=1.5 if step < 30 else -0.5, yaw_rate=0.3), DT_S)
    assert body.camera_pose.z == pytest.approx(2.0, abs=0.25)
    assert body.pose.distance_to(3.0, 0.0) > 1.0


def test_a_drone_that_is_not_installed_is_one_clear_line(monkeypatch):
    monkeypatch.setattr(module, "platform_names", lambda: ["wheeled"])
    with pytest.raises(UsageError, match="adatracker_drone, which is not installed"):
        Embodiment(kind="drone").body()


@settings(max_examples=200)
@given(pitch=st.floats(-90, 90), height=st.floats(0.2, 3.5), fov=st.floats(60, 110), aspect=st.floats(0.5, 1))
def test_a_pitch_is_moved_no_further_than_a_chest_in_view_needs(pitch, height, fov, aspect):
    moved = pitch_in_view_deg(pitch, height, fov, aspect)
    fov = vertical_fov_deg(fov, aspect)
    off_axis = math.degrees(math.atan2(height - 1.3, 2.5)) - moved
    assert abs(off_axis) <= 0.45 * fov + 1e-6
    assert moved == pitch or abs(off_axis) == pytest.approx(0.45 * fov)


@pytest.mark.parametrize(
    ("fov", "aspect", "vertical"), [(90, 1.0, 90.0), (90, 0.75, 73.74), (60, 0.5625, 35.98)]
)
def test_the_vertical_field_of_view_is_a_pinhole_cameras(fov, aspect, vertical):
    assert vertical_fov_deg(fov, aspect) == pytest.approx(vertical, abs=0.01)


def test_a_mask_that_is_wider_than_high_shows_the_middle_of_a_square_one():
    square = make_cell("clean", 1.0, 1.0, TUNING[3])
    wide = dataclasses.replace(square, embodiment=dataclasses.replace(square.embodiment, aspect=0.75))
    whole, middle = Tracking(square).begin().mask, Tracking(wide).begin().mask
    assert middle.shape == (48, 64)
    assert np.array_equal(middle, whole[8:-8])
