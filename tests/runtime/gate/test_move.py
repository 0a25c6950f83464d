"""The gate names its reason for every change to a command: envelope, ramp, close target, altitude band."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
from gate_rig import LIMITS, START_NS, STEP_S, Gate

from adatracker_deploy.core.geometry import Pose
from adatracker_deploy.core.messages import FILLED_M2, ZERO, Twist
from adatracker_deploy.runtime.gate import GateState, Reason, Stage
from adatracker_deploy.runtime.gate.envelope import Envelope, ramped

FULL = Envelope(forward=1.5, backward=0.5, lateral=0.3, up=0.8, down=0.8, yaw_rate=1.2)
FAST = Twist(9.0, 9.0, 9.0, 9.0)


def test_an_envelope_has_the_profiles_limits_and_can_be_scaled():
    assert Envelope.of(LIMITS) == FULL
    half = Envelope(forward=0.75, backward=0.25, lateral=0.15, up=0.4, down=0.4, yaw_rate=0.6)
    assert FULL.times(0.5) == half


def test_an_envelope_clips_each_axis_on_both_sides_and_leaves_what_is_inside():
    uneven = Envelope(forward=1.0, backward=2.0, lateral=3.0, up=4.0, down=5.0, yaw_rate=6.0)
    assert uneven.clip(FAST) == Twist(1.0, 3.0, 4.0, 6.0)
    assert uneven.clip(Twist(-9.0, -9.0, -9.0, -9.0)) == Twist(-2.0, -3.0, -5.0, -6.0)
    inside = Twist(0.5, -2.5, -4.5, 5.5)
    assert uneven.clip(inside) == inside


def test_what_is_asked_beyond_the_envelope_is_clipped_and_named():
    verdict = Gate().cruise(FAST)
    assert (verdict.twist, verdict.reasons) == (Twist(1.5, 0.3, 0.8, 1.2), (Reason.ENVELOPE,))


def test_a_change_that_is_too_quick_is_smoothed_and_named():
    gate = Gate()
    gate.cruise(Twist(1.0))
    assert gate.ask(Twist(-0.5)).reasons == (Reason.ACCELERATION, Reason.JERK)
    gate = Gate(switched_off=("jerk",))
    gate.cruise(Twist(1.0))
    assert gate.ask(Twist(-0.5)).reasons == (Reason.ACCELERATION,)
    assert gate.state.rate.vx == pytest.approx(-2.0 * math.sqrt(0.5))
    gate = Gate()
    gate.cruise(Twist(1.0))
    assert gate.ask(Twist(1.01)).reasons == (Reason.JERK,)


def test_the_ramp_opens_the_envelope_from_the_first_motion_on():
    gate = Gate(accel_m_s2=50.0, jerk_m_s3=1000.0, ramp_s=2.0, lateral_m_s=0.0)
    gate.cruise(ZERO, seconds=5.0)  # standing does not count
    speeds = []
    for _ in range(110):
        verdict = gate.ask(Twist(1.5))
        speeds.append(verdict.twist.vx)
    assert speeds[0] == 0.0
    assert speeds[50] == pytest.approx(0.75, abs=0.02)
    assert speeds[-1] == 1.5
    assert verdict.reasons == ()


def test_the_ramp_is_closed_before_the_first_motion_and_open_without_one():
    still = GateState(armed_ns=START_NS)
    assert ramped(LIMITS, still, START_NS + 10**9) == 0.0
    moving = replace(still, moving_ns=START_NS)
    assert ramped(LIMITS, moving, START_NS + 10**8) == pytest.approx(0.2)
    assert ramped(LIMITS, moving, START_NS + 10**10) == 1.0
    assert ramped(replace(LIMITS, switched_off=("ramp",)), still, START_NS) == 1.0


def test_the_ramp_is_named_while_it_holds_back():
    gate = Gate(ramp_s=2.0)
    assert gate.ask(ZERO).reasons == ()
    assert gate.ask(Twist(1.5)).reasons == (Reason.RAMP,)
    assert Reason.RAMP in gate.cruise(Twist(1.5), seconds=1.9).reasons
    assert gate.cruise(Twist(1.5), seconds=1.0).reasons == ()


def test_without_the_ramp_only_acceleration_and_jerk_hold_back():
    gate = Gate(ramp_s=10.0, switched_off=("ramp",))
    assert gate.ask(Twist(1.5)).reasons == (Reason.ACCELERATION, Reason.JERK)
    assert gate.cruise(Twist(1.5), seconds=1.5).twist.vx == 1.5


def test_a_target_that_is_too_close_stops_forward_motion_at_once_and_nothing_else():
    gate = Gate()
    assert gate.cruise(Twist(1.0, 0.1, 0.1, 0.5), share=0.05).twist.vx == 1.0
    verdict = gate.ask(Twist(1.0, 0.1, 0.1, 0.5), share=0.301)
    assert verdict.twist == Twist(0.0, 0.1, 0.1, 0.5)
    assert (verdict.stage, verdict.reasons[0]) == (Stage.OBEY, Reason.TOO_CLOSE)
    assert gate.state.rate.vx == 0.0
    assert gate.cruise(Twist(-0.4, yaw_rate=0.5), share=0.5).twist == Twist(-0.4, yaw_rate=0.5)


def test_backing_away_from_a_target_that_is_too_close_is_not_named():
    gate = Gate()
    assert gate.cruise(Twist(-0.4), share=0.5).reasons == ()
    assert gate.cruise(ZERO, share=0.5).reasons == ()


def test_coming_back_to_rest_never_swings_forward_while_the_target_is_too_close():
    gate = Gate()
    gate.cruise(Twist(-0.5), share=0.5)
    gate.cruise(Twist(1.0), seconds=0.2, share=0.5)  # brakes hard ...
    seen = [gate.ask(ZERO, share=0.5) for _ in range(100)]  # ... and is asked to stand
    assert all(verdict.twist.vx <= 0.0 for verdict in seen)
    assert seen[-1].twist == ZERO


@pytest.mark.parametrize("share", [math.nan, math.inf])
def test_a_share_that_is_no_number_is_too_close(share):
    assert Gate().cruise(Twist(1.0), share=share).twist.vx == 0.0


def test_a_target_that_was_too_close_and_is_not_seen_is_still_too_close():
    gate = Gate()
    gate.cruise(Twist(1.0), share=0.5)
    assert gate.cruise(Twist(1.0)).twist.vx == 0.0
    assert gate.cruise(Twist(1.0), share=0.05).twist.vx == 1.0
    assert gate.cruise(Twist(1.0)).twist.vx == 1.0


@pytest.mark.parametrize(("room_m", "vx"), [(0.0, 0.0), (0.25, 0.41), (0.45, 0.67), (0.85, 1.0)])
def test_before_the_target_the_robot_is_as_slow_as_it_must_be_to_stop_in_time(room_m, vx):
    gate, nearest_m = Gate(headway_s=0.5), math.sqrt(FILLED_M2 / LIMITS.largest_target)
    share = FILLED_M2 / (nearest_m + room_m) ** 2
    assert gate.cruise(Twist(1.0), share=share).twist.vx == pytest.approx(vx, abs=0.02)
    assert gate.cruise(Twist(1.0), others=0.0).twist.vx == pytest.approx(vx, abs=0.02)  # not in the picture


def test_other_people_who_are_too_close_stop_forward_motion_as_the_target_does():
    gate = Gate()
    assert gate.cruise(Twist(1.0, yaw_rate=0.5), others=0.05).twist.vx == 1.0
    verdict = gate.ask(Twist(1.0, yaw_rate=0.5), others=0.121, share=0.05)
    assert (verdict.twist, verdict.reasons[0]) == (Twist(0.0, yaw_rate=0.5), Reason.TOO_CLOSE)


@pytest.mark.parametrize("seen", [0.0, None], ids=["out of the picture", "no picture"])
def test_who_was_too_close_and_is_out_of_the_picture_is_beside_the_robot_for_a_second(seen):
    gate = Gate()
    gate.cruise(Twist(1.0), others=0.2)
    assert gate.cruise(Twist(1.0), seconds=0.96, others=seen).twist.vx == 0.0
    assert gate.cruise(Twist(1.0), others=seen).twist.vx == 1.0


def test_the_second_begins_anew_with_everybody_who_comes_too_close():
    gate = Gate()
    for _ in range(4):
        gate.ask(Twist(1.0), others=0.2)
        assert gate.cruise(Twist(1.0), seconds=0.9, others=0.0).twist.vx == 0.0


@pytest.mark.parametrize(("away_m", "vx"), [(1.25, 0.0), (1.5, 0.41), (1.7, 0.67), (2.1, 1.0)])
def test_before_other_people_the_robot_is_as_slow_as_it_must_be_to_stop_in_time(away_m, vx):
    gate = Gate(headway_s=0.5)  # at 0.41 m/s it stops within 0.25 m, and may be 1.25 m away
    sent = gate.cruise(Twist(1.0, yaw_rate=0.5), others=0.12 * (1.25 / away_m) ** 2).twist
    assert (sent.vx, sent.yaw_rate) == (pytest.approx(vx, abs=0.02), 0.5)
    assert gate.cruise(Twist(-0.4), others=0.12).twist.vx == -0.4


@pytest.mark.parametrize(("seen_s", "vx"), [(0.0, 0.41), (0.1, 0.36), (0.25, 0.30), (None, 0.41)])
def test_the_robot_has_gone_on_since_the_picture_was_taken(seen_s, vx):
    sent = Gate(headway_s=0.5).cruise(Twist(1.0), others=0.12 * (1.25 / 1.5) ** 2, seen_s=seen_s).twist
    assert sent.vx == pytest.approx(vx, abs=0.01)


def test_others_count_the_whole_age_of_the_last_picture():
    gate = Gate(headway_s=0.5)
    gate.cruise(Twist(1.0), others=0.12 * (1.25 / 1.5) ** 2)
    speeds = [gate.ask(Twist(1.0)).twist.vx for _ in range(40)]  # a hand, and no more pictures
    assert speeds[-1] == pytest.approx(0.19, abs=0.01)


def test_it_stays_slow_for_a_second_after_they_were_as_near():
    gate = Gate(headway_s=0.5)
    slow = gate.cruise(Twist(1.0), others=0.12 * (1.25 / 1.5) ** 2).twist.vx
    assert slow < 0.6
    assert gate.cruise(Twist(1.0), seconds=0.96, others=0.02).twist.vx == slow
    assert gate.cruise(Twist(1.0), others=0.02).twist.vx == 1.0


@pytest.mark.parametrize("others", [math.nan, math.inf])
def test_a_share_of_others_that_is_no_number_is_too_close(others):
    assert Gate().cruise(Twist(1.0), others=others).twist.vx == 0.0


def test_a_gate_that_goes_without_it_lets_the_robot_come_as_near_as_it_likes():
    gate = Gate(switched_off=("too_close",))
    assert gate.cruise(Twist(1.0), share=0.9, others=0.9).twist.vx == 1.0
    assert gate.cruise(Twist(1.0)).twist.vx == 1.0


@pytest.mark.parametrize(("climb", "height_m"), [(0.8, 6.0), (-0.8, 1.0)])
def test_at_the_edge_of_the_altitude_band_only_the_way_back_is_open(climb, height_m):
    gate = Gate()
    asked = Twist(1.0, 0.1, climb, 0.5)
    near = Pose(z=height_m - math.copysign(0.01, climb))
    assert gate.cruise(asked, pose=near).twist == asked
    verdict = gate.ask(asked, pose=Pose(z=height_m))
    assert verdict.twist == Twist(1.0, 0.1, 0.0, 0.5)
    assert (verdict.stage, verdict.reasons[0]) == (Stage.OBEY, Reason.ALTITUDE)
    assert gate.state.rate.vz == 0.0
    back = Twist(vz=-climb)
    assert gate.cruise(back, pose=Pose(z=height_m)).twist == back


def test_the_way_a_climb_needs_to_end_counts():
    """0.8 m/s, 0.2 s late, and 2 m/s^2: 0.32 m."""
    gate = Gate(jumps=True)
    up = Twist(vz=0.8)
    assert gate.cruise(up, pose=Pose(z=5.67), velocity=up).twist == up
    assert gate.ask(up, pose=Pose(z=5.69), velocity=up).twist == ZERO
    gate = Gate(jumps=True)
    gate.cruise(up, velocity=None)  # a robot that does not measure it is taken to do what was sent
    assert gate.ask(up, pose=Pose(z=5.67), velocity=None).twist == up
    assert gate.ask(up, pose=Pose(z=5.69), velocity=None).twist == ZERO


@pytest.mark.parametrize(
    ("limits", "robot"),
    [({"altitude_m": None}, {}), ({"switched_off": ("altitude",)}, {}), ({}, {"pose": None})],
)
def test_without_a_band_or_a_height_there_is_nothing_to_keep(limits, robot):
    up = Twist(vz=0.8)
    assert Gate(**limits).cruise(up, **({"pose": Pose(z=50.0)} | robot)).twist == up


def test_a_cut_keeps_the_rates_of_the_other_axes():
    gate = Gate()
    gate.cruise(Twist(1.0, vz=0.8))
    gate.ask(Twist(1.0, vz=-0.8))
    falling = gate.state.rate.vz
    gate.ask(Twist(1.0, vz=-0.8), share=0.5)
    assert gate.state.rate.vx == 0.0
    assert gate.state.rate.vz < falling < 0.0
    assert gate.state.last.vz == pytest.approx(0.8 + (falling + gate.state.rate.vz) * STEP_S)
