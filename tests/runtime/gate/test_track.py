"""A position that jumps is told from motion, at any rate at which positions come."""

from __future__ import annotations

import itertools
import math
import random

import pytest
from gate_rig import LIMITS, STEP_S, Gate
from hypothesis import given
from hypothesis import strategies as st

from adatracker_deploy.core.geometry import Pose
from adatracker_deploy.core.messages import ZERO, Twist
from adatracker_deploy.runtime.gate import Reason, Stop
from adatracker_deploy.runtime.gate.track import DRIFT_M_S, JUMP_M, Track, fastest_m_s, follow

GO = Twist(1.0)
JUMPED = Stop(Reason.POSITION_JUMPED)
FENCED = {"fence_radius_m": 100.0}


def walked(rate_hz, speed_m_s, seconds, *, noise_m=0.0):
    """Drive a robot whose position comes at a rate, with white noise; return its gate and where it is."""
    gate, dice = Gate(**FENCED), random.Random(0)
    pose, x = Pose(z=2.0), 0.0
    per_position = round(1 / rate_hz / STEP_S)
    for step in range(round(seconds / STEP_S)):
        x += speed_m_s * STEP_S
        if step % per_position == 0:
            pose = Pose(x + dice.gauss(0, noise_m), dice.gauss(0, noise_m), 2.0 + dice.gauss(0, noise_m))
        gate.ask(GO, pose=pose)
    return gate, x


@pytest.mark.parametrize("rate_hz", [50.0, 10.0, 5.0, 1.0])
def test_a_robot_at_its_limit_with_a_real_estimators_errors_is_not_stopped(rate_hz):
    """PX4's velocity is wrong by 0.8 m/s at most, its position by 0.02 m from one to the next."""
    gate, x = walked(rate_hz, LIMITS.forward_m_s + 0.8, 20.0, noise_m=0.02)
    assert gate.state.stop is None
    assert x > 40.0


def test_an_estimate_that_is_corrected_by_what_a_real_one_was_wrong_by_is_believed():
    """PX4's height was wrong by 0.84 m at most."""
    gate, x = walked(50.0, 1.0, 5.0)
    gate.ask(GO, pose=Pose(x + 0.84, z=2.0))
    assert gate.state.stop is None
    gate.cruise(GO, seconds=1.0, pose=Pose(x + 0.84, z=2.0))
    gate.ask(GO, pose=Pose(x, z=2.0))
    assert gate.state.stop is None


@pytest.mark.parametrize("rate_hz", [50.0, 10.0])
@pytest.mark.parametrize("jump_m", [2.0, -2.0, 50.0])
def test_an_odometry_that_jumps_inside_its_fence_stops(rate_hz, jump_m):
    gate, x = walked(rate_hz, 1.0, 5.0, noise_m=0.01)
    gate.ask(GO, pose=Pose(x + jump_m, z=2.0))
    assert gate.state.stop == JUMPED


def test_an_odometry_that_is_reset_stops():
    gate, x = walked(50.0, 1.0, 5.0)
    assert x > 3.0
    gate.ask(GO, pose=Pose(z=2.0))
    assert gate.state.stop == JUMPED


def test_a_height_that_jumps_inside_its_band_stops():
    gate = Gate()
    gate.ask(ZERO, pose=Pose(z=2.0))
    gate.ask(ZERO, pose=Pose(z=5.0))
    assert gate.state.stop == JUMPED


def test_standing_for_long_saves_up_no_jump():
    gate = Gate(**FENCED)
    gate.cruise(ZERO, seconds=60.0)
    most_m = fastest_m_s(LIMITS) * LIMITS.state_timeout_s + JUMP_M
    assert most_m < 5.0
    gate.ask(ZERO, pose=Pose(most_m + 0.01, z=2.0))
    assert gate.state.stop == JUMPED


def test_a_jump_is_told_before_the_fence_that_it_crosses():
    gate = Gate()
    gate.ask(ZERO)
    gate.ask(ZERO, pose=Pose(1000.0, z=2.0))
    assert gate.state.stop == JUMPED
    off = Gate(jumps=True)
    off.ask(ZERO)
    off.ask(ZERO, pose=Pose(1000.0, z=2.0))
    assert off.state.stop == Stop(Reason.GEOFENCE)


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_a_position_that_is_no_number_is_the_fences(bad):
    gate = Gate()
    gate.ask(ZERO)
    gate.ask(ZERO, pose=Pose(bad, z=2.0))
    assert gate.state.stop == Stop(Reason.GEOFENCE)


def test_the_fastest_that_an_estimate_may_move_is_the_speed_limit_and_its_error():
    assert DRIFT_M_S == 1.0
    assert fastest_m_s(LIMITS) == pytest.approx(math.hypot(1.5, 0.3, 0.8) + 1.0)


def test_a_track_goes_straight_to_the_report_as_far_as_motion_reaches():
    began = follow(LIMITS, None, Pose(1.0, 2.0, 3.0), 0)
    assert began == Track((1.0, 2.0, 3.0), (1.0, 2.0, 3.0), 0)
    assert follow(LIMITS, began, None, 10**9) is began
    assert follow(LIMITS, began, Pose(1.0, 2.0, 3.0, yaw=1.0), 10**9) is began
    near = follow(LIMITS, began, Pose(1.1, 2.0, 3.0), 10**8)
    assert near == Track((1.1, 2.0, 3.0), (1.1, 2.0, 3.0), 10**8)
    assert not near.jumped
    far = follow(LIMITS, began, Pose(1.0, 2.0, 13.0), 10**8)
    assert far.reached == pytest.approx((1.0, 2.0, 3.0 + fastest_m_s(LIMITS) * 0.1))
    assert far.jumped


@given(st.lists(st.tuples(st.integers(0, 10**9), st.floats(-5, 5)), min_size=2, max_size=20))
def test_a_track_is_never_faster_than_the_robot(reports):
    track, now_ns, since_ns = None, 0, 0
    for (pause_ns, x), _ in itertools.pairwise(reports):
        now_ns += pause_ns
        before, track = track, follow(LIMITS, track, Pose(x), now_ns)
        if before is not None and track is not before:
            moved_m = math.dist(before.reached, track.reached)
            assert moved_m <= fastest_m_s(LIMITS) * (now_ns - since_ns) / 1e9 + 1e-9
        since_ns = track.reported_ns
