"""The simulated base's motion: limits, acceleration, lag, delay, slip and steering."""

import dataclasses
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from wheeled_rig import base_profile

from adatracker_deploy.core.geometry import Pose
from adatracker_deploy.core.messages import ZERO, Twist
from adatracker_wheeled.sim.dynamics import WheeledBody

STEP_S = 0.01


def body(name="scout", **sitl):
    profile = base_profile(name)
    settings = dataclasses.replace(profile.sitl, **{"slip": 0.0, "delay_s": 0.0, "lag_s": 0.0, **sitl})
    return WheeledBody(settings, profile.connection.roles)


def run(body, command, seconds):
    for _ in range(round(seconds / STEP_S)):
        body.step(command, STEP_S)
    return body


def test_without_slip_it_goes_where_its_wheels_roll():
    one = run(body(accel_m_s2=50), Twist(vx=1.0), 5.0)
    assert one.pose.x == pytest.approx(5.0, abs=0.02)
    assert one.wheels_m == pytest.approx((one.pose.x, one.pose.x))


def test_a_full_turn_comes_back_to_where_it_began():
    one = body(accel_m_s2=50, yaw_accel_rad_s2=100)
    one.measured = turning = Twist(vx=0.5, yaw_rate=1.0)
    run(one, turning, math.tau)
    assert one.pose.distance_to(0.0, 0.0) < 0.02


@given(st.floats(-20, 20), st.floats(-20, 20), st.floats(0.001, 0.05))
def test_it_never_exceeds_its_limits_or_its_acceleration(vx, yaw_rate, dt_s):
    one = body(forward_m_s=1.5, backward_m_s=1.0, yaw_rate_rad_s=2.0, accel_m_s2=2.0, yaw_accel_rad_s2=6.0)
    for _ in range(20):
        before = one.measured
        one.step(Twist(vx=vx, yaw_rate=yaw_rate), dt_s)
        assert -1.0 <= one.measured.vx <= 1.5
        assert abs(one.measured.yaw_rate) <= 2.0
        assert abs(one.measured.vx - before.vx) <= 2.0 * dt_s + 1e-9
        assert abs(one.measured.yaw_rate - before.yaw_rate) <= 6.0 * dt_s + 1e-9


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_a_command_that_is_not_finite_stands_for_zero(value):
    one = run(body(), Twist(vx=1.0), 2.0)
    run(one, Twist(vx=value, yaw_rate=value), 2.0)
    assert one.velocity == ZERO


def test_the_lag_is_the_time_in_which_two_thirds_of_a_step_are_done():
    one = run(body(lag_s=0.2, accel_m_s2=50), Twist(vx=1.0), 0.2)
    assert one.velocity.vx == pytest.approx(1 - math.exp(-1), abs=0.01)


def test_the_delay_passes_before_anything_moves():
    one = run(body(delay_s=0.1), Twist(vx=1.0), 0.1)
    assert one.velocity == ZERO
    assert run(one, Twist(vx=1.0), 0.05).velocity.vx > 0


def test_slip_makes_odometry_drift_by_a_share_that_the_seed_decides():
    shares = set()
    for seed in range(5):
        one = body(slip=0.1, accel_m_s2=50)
        one.reset(Pose(), seed)
        run(one, Twist(vx=1.0), 5.0)
        left, right = one.wheels_m
        assert left == right
        assert 0.0 < 1 - one.velocity.vx / one.measured.vx < 0.1
        assert one.velocity.yaw_rate != 0
        shares.add(one.velocity.vx)
    assert len(shares) == 5


def test_a_steered_base_cannot_turn_where_it_stands_nor_tighter_than_its_circle():
    hunter = base_profile("hunter").connection.roles.steering
    one = run(body("hunter"), Twist(yaw_rate=1.0), 2.0)
    assert one.pose == Pose()
    run(one, Twist(vx=1.0, yaw_rate=5.0), 3.0)
    tightest_m = hunter.wheelbase_m / math.tan(hunter.max_angle_rad)
    assert one.velocity.vx == pytest.approx(1.0, rel=0.01)
    assert abs(one.velocity.vx / one.velocity.yaw_rate) > 0.99 * tightest_m


def test_an_obstacle_stops_the_body_and_not_its_wheels():
    one = run(body(), Twist(vx=1.0), 2.0)
    rolled = one.wheels_m
    one.place(Pose(x=1.0))
    assert one.pose == Pose(x=1.0)
    assert one.wheels_m == rolled
    assert one.velocity.vx > 0


def test_the_camera_rides_on_its_mount():
    one = body()
    one.reset(Pose(yaw=math.pi / 2), 0)
    mount = one.settings.camera
    assert one.camera_pose.y == pytest.approx(mount.forward_m)
    assert one.camera_pose.z == pytest.approx(mount.up_m)
