from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from adatracker_deploy.core.geometry import Pose
from adatracker_deploy.core.messages import Twist
from adatracker_deploy.platform import CameraMount
from adatracker_deploy.sim.bodies import DriveSettings, KinematicBody


def body(**settings) -> KinematicBody:
    return KinematicBody(DriveSettings(**settings))


def run(drive: KinematicBody, command: Twist, seconds: float, steps: int) -> None:
    for _ in range(steps):
        drive.step(command, seconds / steps)


def test_a_constant_command_drives_a_circle_whatever_the_step():
    coarse, fine = body(), body()
    command = Twist(vx=1.0, yaw_rate=0.5)
    run(coarse, command, 2.0, 20)
    run(fine, command, 2.0, 2000)
    radius = 2.0
    exact = (radius * math.sin(1.0), radius * (1 - math.cos(1.0)))
    assert (fine.pose.x, fine.pose.y) == pytest.approx(exact, abs=1e-5)
    assert (coarse.pose.x, coarse.pose.y) == pytest.approx(exact, abs=1e-3)
    assert coarse.pose.yaw == pytest.approx(1.0)


@given(steps=st.integers(1, 50))
def test_after_one_time_constant_63_percent_of_the_speed_is_reached(steps):
    drive = body(lag_s=0.4)
    run(drive, Twist(vx=1.0, yaw_rate=-1.0), 0.4, steps)
    assert drive.velocity.vx == pytest.approx(1 - math.exp(-1))
    assert drive.velocity.yaw_rate == pytest.approx(math.exp(-1) - 1)


@pytest.mark.parametrize("steps", [3, 30, 7])
def test_nothing_moves_before_the_delay_is_over(steps):
    drive = body(delay_s=0.3)
    run(drive, Twist(vx=1.0), 0.3, steps)
    assert drive.pose == Pose()
    drive.step(Twist(), 0.1)
    assert drive.pose.x == pytest.approx(0.1)


def test_commands_are_clipped_to_the_limits_and_other_axes_ignored():
    drive = body(forward_m_s=1.0, backward_m_s=0.4, yaw_rate_rad_s=2.0)
    drive.step(Twist(vx=5.0, vy=1.0, vz=1.0, yaw_rate=-9.0), 0.1)
    assert drive.velocity == Twist(vx=1.0, yaw_rate=-2.0)
    drive.step(Twist(vx=-5.0), 0.1)
    assert drive.velocity == Twist(vx=-0.4)


def test_a_command_that_is_not_finite_stands_for_zero():
    drive = body()
    drive.step(Twist(vx=math.nan, yaw_rate=1.0), 0.1)
    assert drive.pose == Pose()


def test_placing_keeps_the_velocity_and_reset_does_not():
    drive = body(lag_s=0.5, delay_s=0.2)
    run(drive, Twist(vx=1.0), 1.0, 10)
    velocity = drive.velocity
    drive.place(Pose(x=3.0, z=0.2, pitch=0.1))
    assert drive.velocity == velocity
    assert drive.pose == Pose(x=3.0, z=0.2, pitch=0.1)
    drive.reset(Pose(y=1.0), seed=0)
    drive.step(Twist(), 1.0)
    assert drive.pose == Pose(y=1.0)


def test_the_camera_sits_where_the_mount_says():
    drive = body(camera=CameraMount(forward_m=0.2, up_m=0.5, pitch_deg=10.0))
    drive.place(Pose(x=1.0, y=2.0, yaw=math.pi / 2))
    at = drive.camera_pose
    assert (at.x, at.y, at.z) == pytest.approx((1.0, 2.2, 0.5))
    assert (at.pitch, at.yaw) == pytest.approx((math.radians(10.0), math.pi / 2))
