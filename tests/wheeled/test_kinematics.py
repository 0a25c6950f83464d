"""Velocities to wheels or a steering angle and back, against geometry worked out by hand."""

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from adatracker_deploy.core.messages import ZERO, Twist
from adatracker_wheeled.protocol.kinematics import CREEP_M_S, Drive
from adatracker_wheeled.protocol.roles import Steering, Wheels

speeds = st.floats(-3, 3)
DIFFERENTIAL = Drive(wheels=Wheels(track_m=0.5))
BICYCLE = Drive(steering=Steering(wheelbase_m=0.6, max_angle_rad=0.5))
INNER = Drive(steering=Steering(wheelbase_m=0.6, max_angle_rad=0.5, inner_track_m=0.4))
steered = pytest.mark.parametrize("drive", [BICYCLE, INNER])


def sent_and_heard(drive, twist, *names):
    said = drive.quantities(twist)
    return drive.twist({name: said[name] for name in names})


def test_turning_left_on_the_spot_the_left_wheel_rolls_back():
    said = DIFFERENTIAL.quantities(Twist(yaw_rate=2.0))
    assert (said["left_m_s"], said["right_m_s"]) == (-0.5, 0.5)


def test_circling_left_at_one_metre_the_right_wheel_is_half_a_track_farther_out():
    said = DIFFERENTIAL.quantities(Twist(vx=1.0, yaw_rate=1.0))
    assert (said["left_m_s"], said["right_m_s"]) == (0.75, 1.25)


@settings(deadline=None)
@given(vx=speeds, yaw_rate=speeds)
def test_wheel_speeds_say_all_of_a_velocity_in_the_plane(vx, yaw_rate):
    heard = sent_and_heard(DIFFERENTIAL, Twist(vx=vx, yaw_rate=yaw_rate), "left_m_s", "right_m_s")
    assert (heard.vx, heard.yaw_rate) == pytest.approx((vx, yaw_rate), abs=1e-9)


def test_a_bicycles_angle_is_the_arc_tangent_of_wheelbase_over_radius():
    assert BICYCLE.quantities(Twist(vx=1.0, yaw_rate=0.5))["steering_rad"] == pytest.approx(
        math.atan(0.6 / 2.0)
    )


def test_the_inner_wheel_turns_on_a_circle_smaller_by_half_the_track():
    assert INNER.quantities(Twist(vx=1.0, yaw_rate=0.5))["steering_rad"] == pytest.approx(
        math.atan(0.6 / (2.0 - 0.2))
    )


@steered
def test_backing_up_to_the_left_needs_the_wheels_to_the_right(drive):
    assert drive.quantities(Twist(vx=-1.0, yaw_rate=0.3))["steering_rad"] < 0
    heard = sent_and_heard(drive, Twist(vx=-1.0, yaw_rate=0.3), "vx_m_s", "steering_rad")
    assert heard.yaw_rate == pytest.approx(0.3)


@steered
@settings(deadline=None)
@given(vx=speeds, yaw_rate=speeds)
def test_steering_never_passes_its_stop_and_never_turns_the_other_way(drive, vx, yaw_rate):
    said = drive.quantities(Twist(vx=vx, yaw_rate=yaw_rate))
    heard = sent_and_heard(drive, Twist(vx=vx, yaw_rate=yaw_rate), "vx_m_s", "steering_rad")
    assert abs(said["steering_rad"]) <= 0.5
    assert heard.vx == vx
    assert abs(heard.yaw_rate) <= abs(yaw_rate) + 1e-9
    assert heard.yaw_rate * yaw_rate >= 0
    if abs(said["steering_rad"]) < 0.5 and abs(vx) >= CREEP_M_S:
        assert heard.yaw_rate == pytest.approx(yaw_rate, abs=1e-9)


@steered
def test_a_standing_car_keeps_its_wheels_straight_and_does_not_turn(drive):
    assert drive.quantities(Twist(yaw_rate=1.0))["steering_rad"] == 0.0
    assert drive.quantities(Twist(vx=0.9 * CREEP_M_S, yaw_rate=1.0))["steering_rad"] == 0.0
    assert sent_and_heard(drive, Twist(yaw_rate=1.0), "vx_m_s", "steering_rad") == ZERO


@settings(deadline=None)
@given(vx=speeds, vy=speeds, yaw_rate=speeds)
def test_a_base_that_takes_velocities_gets_them_as_they_are(vx, vy, yaw_rate):
    twist = Twist(vx=vx, vy=vy, yaw_rate=yaw_rate)
    assert sent_and_heard(Drive(), twist, "vx_m_s", "vy_m_s", "yaw_rate_rad_s") == twist
