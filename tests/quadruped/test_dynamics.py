"""The walking body: how soon and how truly it follows, what it slips, and what its camera sees."""

import dataclasses
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from adatracker_deploy.core.geometry import Pose, wrap_angle
from adatracker_deploy.core.messages import ZERO, Twist
from adatracker_quadruped.sim.dynamics import QuadrupedBody
from adatracker_quadruped.sim.settings import GaitSettings, SitlSettings

FIRM = SitlSettings(slip=0.0)
STEP_S = 0.01


def walked(command, seconds, settings=FIRM, *, start=None, seed=0, step_s=STEP_S):
    body = QuadrupedBody(settings)
    body.reset(start or Pose(), seed)
    for _ in range(round(seconds / step_s)):
        body.step(command, step_s)
    return body


def test_nothing_happens_before_the_delay_and_63_percent_after_one_lag_more():
    assert walked(Twist(vx=1.0), 0.04).velocity == ZERO
    assert walked(Twist(vx=1.0), 0.04 + 0.2).velocity.vx == pytest.approx(1 - math.exp(-1), abs=0.03)
    assert walked(Twist(vx=1.0), 3.0).velocity.vx == pytest.approx(1.0, abs=1e-3)


@pytest.mark.parametrize(
    ("command", "dx", "dy", "turn"),
    [
        (Twist(vx=1.0), 0.0, 1.0, 0.0),
        (Twist(vx=-0.5), 0.0, -0.5, 0.0),
        (Twist(vy=0.5), -0.5, 0.0, 0.0),
        (Twist(yaw_rate=1.0), 0.0, 0.0, 1.0),
        (Twist(vz=1.0), 0.0, 0.0, 0.0),
    ],
)
def test_forward_is_where_the_nose_points_left_is_beside_it_and_turns_are_counter_clockwise(
    command, dx, dy, turn
):
    start = Pose(yaw=math.pi / 2)
    at = walked(command, 2.24, start=start).pose  # two seconds, the lag and the delay
    assert (at.x, at.y) == pytest.approx((2 * dx, 2 * dy), abs=0.02)
    assert wrap_angle(at.yaw - start.yaw) == pytest.approx(2 * turn, abs=0.02)


def test_it_stands_perfectly_still_soon_after_a_zero():
    body = walked(Twist(vx=1.0, yaw_rate=0.5), 2.0)
    for _ in range(150):
        body.step(ZERO, STEP_S)
    assert body.velocity == ZERO
    at, camera = body.pose, body.camera_pose
    for _ in range(100):
        body.step(ZERO, STEP_S)
    assert body.pose == at
    assert body.camera_pose.z == pytest.approx(camera.z, abs=1e-4)


def test_slip_takes_its_share_of_the_way_and_differs_from_episode_to_episode():
    slippery = SitlSettings(slip=0.1)
    ways_m = [walked(Twist(vx=1.0), 5.24, slippery, seed=seed).pose.x for seed in range(40)]
    assert len(set(ways_m)) == 40
    assert sum(ways_m) / 40 == pytest.approx(5.0 * 0.9, rel=0.03)
    assert max(ways_m) <= 5.01
    assert min(ways_m) > 5.0 * 0.7


def test_the_same_seed_walks_the_same_way_to_the_bit():
    command = Twist(vx=1.2, vy=-0.1, yaw_rate=0.7)
    one, other = (walked(command, 3.0, SitlSettings(), seed=5) for _ in range(2))
    assert (one.pose, one.camera_pose, one.velocity) == (other.pose, other.camera_pose, other.velocity)


def test_the_callers_step_size_matters_little():
    command = Twist(vx=1.0, yaw_rate=0.5)
    fine, coarse = walked(command, 3.0), walked(command, 3.0, step_s=0.05)
    assert fine.pose.distance_to(coarse.pose.x, coarse.pose.y) < 0.05


def test_where_the_world_puts_it_it_walks_on_from():
    body = walked(Twist(vx=1.0), 2.0)
    body.place(Pose(5.0, 5.0, 0.3, roll=0.1, pitch=-0.2, yaw=1.0))
    assert body.velocity.vx == pytest.approx(1.0, abs=0.01)
    body.step(Twist(vx=1.0), STEP_S)
    assert body.pose.distance_to(5.0, 5.0) == pytest.approx(STEP_S * math.cos(0.2), rel=0.05)


def test_the_camera_trots_with_the_trunk_and_the_body_stays_on_the_ground():
    settings = dataclasses.replace(FIRM, gait=GaitSettings(uneven_m=0.0))
    body = walked(Twist(vx=1.5), 1.0, settings)
    heights, pitches = [], []
    for _ in range(200):
        body.step(Twist(vx=1.5), STEP_S)
        heights.append(body.camera_pose.z)
        pitches.append(body.camera_pose.pitch)
        assert body.pose.z == body.pose.roll == body.pose.pitch == 0.0
    swing_m = (max(heights) - min(heights)) / 2
    assert swing_m == pytest.approx(settings.gait.bob_m, rel=0.7)  # the camera is ahead of where it pitches
    assert (max(pitches) - min(pitches)) / 2 == pytest.approx(math.radians(1.0), rel=0.1)


ANY = st.floats()


@given(st.builds(Twist, vx=ANY, vy=ANY, vz=ANY, yaw_rate=ANY), st.floats(1e-4, 0.25))
def test_no_command_upsets_it(command, step_s):
    body = QuadrupedBody(SitlSettings())
    for _ in range(20):
        body.step(command, step_s)
    assert body.velocity.is_finite()
    assert abs(body.velocity.vx) <= 2.5
    assert abs(body.velocity.yaw_rate) <= 2.5
    assert math.isfinite(body.camera_pose.z)
