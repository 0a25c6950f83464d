"""Dead reckoning from the wheels matches paths worked out by hand."""

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from adatracker_deploy.core.geometry import Pose
from adatracker_deploy.core.messages import Twist
from adatracker_wheeled.adapter.odometry import DeadReckoning

STEP_NS = 20_000_000
WRAP_M = 2**32 / 1000
START = DeadReckoning(track_m=0.5, wrap_m=WRAP_M)


def roll(reckoning, distances, first_ns=STEP_NS):
    for i, wheels_m in enumerate(distances):
        reckoning = reckoning.rolled(wheels_m, first_ns + i * STEP_NS)
    return reckoning


def place(reckoning):
    return reckoning.pose.x, reckoning.pose.y, reckoning.pose.yaw


def test_a_quarter_circle_of_one_metre_ends_a_metre_ahead_and_a_metre_to_the_left():
    arc = [math.pi / 2 * i / 100 for i in range(101)]
    reckoning = roll(START, [(0.75 * a, 1.25 * a) for a in arc])
    assert place(reckoning) == pytest.approx((1.0, 1.0, math.pi / 2))


@settings(deadline=None)
@given(vx=st.floats(-2, 2), yaw_rate=st.floats(-2, 2))
def test_any_circle_is_exact_by_velocity_and_by_wheels(vx, yaw_rate):
    by_velocity, by_wheels = DeadReckoning(), START
    for i in range(51):
        t_s = i * 0.02
        by_velocity = by_velocity.moved(Twist(vx=vx, yaw_rate=yaw_rate), (i + 1) * STEP_NS)
        way, turned = vx * t_s, yaw_rate * t_s * 0.25
        by_wheels = by_wheels.rolled((way - turned, way + turned), (i + 1) * STEP_NS)
    x = vx * math.sin(yaw_rate) / yaw_rate if abs(yaw_rate) > 1e-6 else vx
    y = vx * (1 - math.cos(yaw_rate)) / yaw_rate if abs(yaw_rate) > 1e-6 else 0.0
    assert place(by_velocity) == pytest.approx((x, y, yaw_rate), abs=1e-5)
    assert place(by_wheels) == pytest.approx((x, y, yaw_rate), abs=1e-5)


def test_sliding_sideways_counts_for_bases_that_can():
    reckoning = DeadReckoning(pose=Pose(yaw=math.pi / 2), t_ns=0).moved(Twist(vy=1.0), STEP_NS)
    assert place(reckoning) == pytest.approx((-0.02, 0.0, math.pi / 2))


@settings(deadline=None)
@given(start=st.floats(-WRAP_M / 2, WRAP_M / 2))
def test_the_first_reading_moves_nothing_wherever_the_counters_stand(start):
    assert roll(START, [(start, start)]).pose == Pose()


def test_a_counter_that_wraps_around_does_not_jump():
    top = 2147483.647
    reckoning = roll(START, [(top, top), (-top - 0.001 + 0.009, -top - 0.001 + 0.009)])
    assert place(reckoning) == pytest.approx((0.010, 0.0, 0.0), abs=1e-6)


@pytest.mark.parametrize("after", [0.0, 0.4, -1500.0])
def test_a_base_that_was_switched_off_and_on_does_not_jump(after):
    before = roll(START, [(70.0, 70.0), (70.01, 70.01)])
    restarted = before.rolled((after, after), 3 * STEP_NS)
    assert restarted.pose == before.pose
    assert restarted.rolled((after + 0.01, after + 0.01), 4 * STEP_NS).pose.x == pytest.approx(0.02)


def test_what_happened_in_a_long_silence_is_not_guessed():
    before = roll(START, [(0.0, 0.0), (0.01, 0.01)])
    assert before.rolled((1.0, 1.0), 2 * STEP_NS + 1_000_000_000).pose == before.pose
    moving = DeadReckoning(t_ns=0).moved(Twist(vx=1.0), 1_000_000_000)
    assert moving.pose == Pose()


@pytest.mark.parametrize("gap_ns", [0, 1, 1_000_000])
def test_readings_that_arrive_in_a_bunch_lose_no_distance(gap_ns):
    reckoning = START.rolled((0.0, 0.0), STEP_NS)
    for i in (1, 2, 3):
        reckoning = reckoning.rolled((0.03 * i, 0.03 * i), 4 * STEP_NS + i * gap_ns)
    assert place(reckoning) == pytest.approx((0.09, 0.0, 0.0))


def test_a_velocity_holds_for_no_time_when_time_runs_backwards():
    assert DeadReckoning(t_ns=STEP_NS).moved(Twist(vx=1.0), 0).pose == Pose()


def test_without_a_track_the_wheels_tell_no_pose():
    assert roll(DeadReckoning(), [(0.0, 0.0), (0.01, 0.01)]).pose == Pose()
