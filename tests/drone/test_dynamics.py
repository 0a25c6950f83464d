"""The drone's dynamics: what a policy feels, bounded by figures measured on the model."""

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from adatracker_deploy.core.geometry import Pose
from adatracker_deploy.core.messages import ZERO, Twist
from adatracker_drone.sim.dynamics import STEP_S, DroneBody, Power
from adatracker_drone.sim.settings import SitlSettings

HIGH = Pose(z=5.0)


def flown(command, seconds, *, start=HIGH, settle_s=1.0, seed=0, body=None):
    """Hover, then follow one command; return the body and its velocity at every step."""
    body = body or DroneBody()
    body.reset(start, seed)
    body.step(ZERO, settle_s)
    velocities = []
    for _ in range(round(seconds / STEP_S)):
        body.step(command, STEP_S)
        velocities.append(body.velocity)
    return body, velocities


def rise_time_s(values, target):
    return next(i for i, value in enumerate(values) if value / target >= 0.9) * STEP_S


def test_it_hovers_where_it_was_put():
    body, _ = flown(ZERO, 10.0, start=Pose(3.0, -2.0, 2.0, yaw=0.7))
    assert math.dist((body.pose.x, body.pose.y, body.pose.z), (3.0, -2.0, 2.0)) < 0.05
    assert body.pose.yaw == pytest.approx(0.7, abs=0.01)


@pytest.mark.parametrize(
    ("command", "axis", "within_s"),
    [
        (Twist(vx=1.0), "vx", 1.3),
        (Twist(vx=-1.0), "vx", 1.3),
        (Twist(vy=1.0), "vy", 1.3),
        (Twist(vz=0.8), "vz", 0.8),
        (Twist(vz=-0.8), "vz", 0.8),
        (Twist(yaw_rate=math.radians(30)), "yaw_rate", 0.6),
        (Twist(yaw_rate=-math.radians(90)), "yaw_rate", 0.6),
    ],
)
def test_each_axis_reaches_its_command_soon_and_without_much_overshoot(command, axis, within_s):
    _, velocities = flown(command, 4.0)
    target = getattr(command, axis)
    values = [getattr(velocity, axis) for velocity in velocities]
    assert rise_time_s(values, target) < within_s
    assert max(value / target for value in values) < 1.10
    assert values[-1] == pytest.approx(target, rel=0.06)
    others = {"vx", "vy", "vz", "yaw_rate"} - {axis}
    assert max(abs(getattr(velocities[-1], name)) for name in others) < 0.1


def test_a_turn_at_speed_slips_little_sideways():
    _, velocities = flown(Twist(vx=1.5, yaw_rate=math.radians(45)), 8.0)
    assert max(abs(velocity.vy) for velocity in velocities) < 0.25


def test_forward_is_where_the_nose_points_and_left_is_to_its_left():
    body, _ = flown(Twist(vx=1.0), 3.0, start=Pose(z=5.0, yaw=math.pi / 2))
    assert body.pose.y > 1.5
    assert abs(body.pose.x) < 0.1
    body, _ = flown(Twist(vy=1.0), 3.0, start=Pose(z=5.0, yaw=math.pi / 2))
    assert body.pose.x < -1.5


def test_speeding_up_pitches_the_nose_down():
    body, _ = flown(Twist(vx=2.0), 0.4)
    assert body.pose.pitch > 0.05


def test_at_height_zero_it_stands_with_its_motors_off():
    body = DroneBody()
    body.reset(Pose(1.0, 2.0, 0.0, yaw=-0.4), 0)
    assert body.power is Power.OFF
    body.step(Twist(vz=2.0), 3.0)
    assert body.motion.on_gear
    assert math.dist((body.pose.x, body.pose.y, body.pose.z), (1.0, 2.0, 0.0)) < 0.01


def test_it_lifts_off_only_when_its_motors_fly_and_lands_again():
    body = DroneBody()
    body.power = Power.IDLE
    body.step(Twist(vz=1.0), 2.0)
    assert body.motion.on_gear
    body.power = Power.FLY
    body.step(Twist(vz=1.0), 3.0)
    assert body.pose.z > 1.5
    body.step(Twist(vz=-0.7), 6.0)
    assert body.motion.on_gear
    assert abs(body.velocity.vz) < 0.05
    assert abs(body.pose.roll) + abs(body.pose.pitch) < 0.05


@pytest.mark.parametrize("weather", [SitlSettings(), SitlSettings(wind_m_s=4.0, gust_m_s=1.0)])
def test_two_fresh_bodies_fly_the_same_to_the_bit(weather):
    command = Twist(1.3, -0.2, 0.1, 0.6)
    first, one = flown(command, 3.0, seed=7, body=DroneBody(weather))
    second, other = flown(command, 3.0, seed=7, body=DroneBody(weather))
    assert one == other
    assert first.pose == second.pose


def test_a_body_that_has_flown_starts_again_as_a_fresh_one():
    used, _ = flown(Twist(vx=2.0, yaw_rate=1.0), 2.0)
    _, again = flown(Twist(vx=1.0), 2.0, seed=3, body=used)
    _, fresh = flown(Twist(vx=1.0), 2.0, seed=3)
    assert again == fresh


def test_wind_is_withstood_and_differs_from_seed_to_seed():
    windy = SitlSettings(wind_m_s=5.0, gust_m_s=0.5)
    ends = set()
    for seed in range(3):
        body, velocities = flown(ZERO, 10.0, seed=seed, body=DroneBody(windy))
        assert max(math.hypot(v.vx, v.vy) for v in velocities[-500:]) < 0.4
        ends.add((body.pose.x, body.pose.y))
    assert len(ends) == 3


def test_the_step_size_of_the_caller_does_not_matter():
    one, other = DroneBody(), DroneBody()
    for body in (one, other):
        body.reset(HIGH, 0)
    for _ in range(10):
        one.step(Twist(vx=1.0), 0.1)
    for _ in range(250):
        other.step(Twist(vx=1.0), 0.004)
    assert one.pose == other.pose


def test_the_camera_looks_ahead_and_down_and_tilts_with_the_airframe():
    body = DroneBody()
    body.reset(Pose(z=2.0, yaw=1.0), 0)
    camera = body.camera_pose
    assert camera.yaw == pytest.approx(1.0, abs=1e-6)
    assert camera.pitch == pytest.approx(math.radians(20), abs=1e-6)
    assert camera.z == pytest.approx(2.1, abs=1e-6)
    body.step(Twist(vx=2.0), 0.4)
    assert body.camera_pose.pitch > math.radians(22)


@settings(max_examples=15, deadline=None)
@given(
    st.builds(
        Twist,
        vx=st.floats(-5, 5),
        vy=st.floats(-5, 5),
        vz=st.floats(-1.5, 3),
        yaw_rate=st.floats(-3, 3),
    )
)
def test_no_command_upsets_it(command):
    body, _ = flown(command, 3.0, start=Pose(z=20.0), settle_s=0.2)
    assert body.velocity.is_finite()
    assert max(abs(body.pose.roll), abs(body.pose.pitch)) < math.radians(45)
