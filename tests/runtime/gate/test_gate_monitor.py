"""The robot's state can stop it for good: takeover, silence, empty battery, geofence, altitude."""

from __future__ import annotations

import math

import pytest
from gate_rig import LIMITS, WELL, Gate

from adatracker_deploy.core.geometry import Pose
from adatracker_deploy.core.messages import ZERO, PlatformState, Twist
from adatracker_deploy.runtime.gate import Reason, Stage, Stop, unmonitored
from adatracker_deploy.runtime.gate.place import STRAY_M

GO = Twist(1.0, yaw_rate=0.5)
SQUARE = ((-1.0, -1.0), (3.0, -1.0), (3.0, 2.0), (-1.0, 2.0))


def stopped(gate: Gate, **robot) -> Stop | None:
    """Drive a healthy robot, then take one step with the given state; return the stop that latched."""
    assert gate.cruise(GO).twist == GO
    verdict = gate.ask(GO, **robot)
    assert (verdict.twist == ZERO) is (gate.state.stop is not None)
    if gate.state.stop is not None:
        assert (verdict.stage, verdict.reasons) == (gate.state.stop.stage, (gate.state.stop.reason,))
    return gate.state.stop


def test_a_robot_that_has_stopped_is_not_driven_and_its_words_are_kept():
    words = "the motor driver is too hot"
    assert stopped(Gate(), stopped=words) == Stop(Reason.ROBOT_STOPPED, words)
    assert stopped(Gate(), stopped="the pilot", taken_over=True) == Stop(Reason.TAKEOVER, "the pilot")
    both = {"stopped": "the pilot", "taken_over": True, "engaged": False, "battery": 0.0}
    assert stopped(Gate(), **both) == Stop(Reason.TAKEOVER, "the pilot")


def test_a_robot_that_no_longer_obeys_is_stopped():
    assert stopped(Gate(), engaged=False) == Stop(Reason.NOT_ENGAGED)


def test_a_robot_that_is_not_heard_is_stopped():
    gate = Gate()
    assert gate.cruise(GO).twist == GO
    heard_ns = gate.now_ns
    assert gate.cruise(GO, seconds=1.0, t_ns=heard_ns).twist == GO
    gate.ask(GO, dt_s=1e-9, t_ns=heard_ns)
    assert gate.state.stop == Stop(Reason.STATE_LOST)


def test_a_robot_that_is_heard_from_the_future_is_stopped():
    ahead_ns = round(3.02e9) + 10**9
    gate = Gate()
    assert stopped(gate, t_ns=gate.now_ns + ahead_ns) is None
    gate = Gate()
    assert stopped(gate, t_ns=gate.now_ns + ahead_ns + 1) == Stop(Reason.STATE_LOST)


def test_what_the_robot_says_is_no_news_when_it_is_older_than_what_it_said_before():
    gate = Gate()
    assert gate.cruise(GO).twist == GO
    heard_ns = gate.now_ns
    gate.ask(GO, t_ns=heard_ns)
    assert gate.state.stop is None
    gate.ask(GO, t_ns=heard_ns - 1)
    assert gate.state.stop == Stop(Reason.STATE_LOST)
    assert stopped(Gate(), t_ns=0) == Stop(Reason.STATE_LOST)


@pytest.mark.parametrize(("said", "reason"), [("battery", "battery_lost"), ("pose", "position_lost")])
def test_a_measurement_that_was_told_and_is_not_any_more_stops(said, reason):
    assert stopped(Gate(), **{said: None}) == Stop(Reason(reason))
    gate = Gate()
    gate.cruise(GO, **{said: None})  # one that was never told is not missed
    assert gate.state.stop is None
    gate.ask(GO)
    gate.ask(GO, **{said: None})
    assert gate.state.stop == Stop(Reason(reason))


def test_what_nothing_that_is_switched_on_needs_is_not_missed():
    assert stopped(Gate(switched_off=("battery",)), battery=None) is None
    assert stopped(Gate(switched_off=("geofence",)), pose=None) == Stop(Reason.POSITION_LOST)
    assert stopped(Gate(switched_off=("geofence",), altitude_m=None), pose=None) is None
    assert stopped(Gate(switched_off=("geofence", "altitude")), pose=None) is None
    assert stopped(Gate(altitude_m=None), pose=None) == Stop(Reason.POSITION_LOST)


@pytest.mark.parametrize("charge", [0.2, 0.0, math.nan])
def test_an_empty_battery_disengages(charge):
    assert stopped(Gate(), battery=charge) == Stop(Reason.BATTERY, stage=Stage.DISENGAGE)


def test_a_low_battery_is_told_and_changes_nothing():
    gate = Gate()
    assert stopped(gate, battery=0.201) is None
    assert gate.ask(GO, battery=0.31).warnings == ()
    verdict = gate.ask(GO, battery=0.3)
    assert (verdict.warnings, verdict.reasons, verdict.twist) == ((Reason.BATTERY_LOW,), (), GO)
    assert gate.ask(GO, battery=math.nan).warnings == (Reason.BATTERY_LOW,)
    assert gate.ask(GO, battery=0.25).warnings == (Reason.BATTERY_LOW,)  # stopped, and still told
    assert gate.ask(None, dt_s=0.3, battery=0.25).warnings == (Reason.BATTERY_LOW,)


def test_a_low_battery_is_told_also_when_the_command_is_stale():
    gate = Gate()
    gate.cruise(GO)
    verdict = gate.ask(GO, age_s=0.3, battery=0.25)
    assert (verdict.reasons, verdict.warnings) == ((Reason.STALE,), (Reason.BATTERY_LOW,))


@pytest.mark.parametrize("yaw", [0.0, 2.0])
@pytest.mark.parametrize("bearing", [0.0, 1.0, 3.0, -2.0])
def test_the_fence_is_a_cylinder_around_where_the_robot_was_engaged(yaw, bearing):
    start = Pose(x=30.0, y=-20.0, z=2.0, yaw=yaw)

    def at(radius_m):
        return Pose(30.0 + radius_m * math.cos(bearing), -20.0 + radius_m * math.sin(bearing), 2.0)

    gate = Gate(jumps=True)
    gate.ask(ZERO, pose=start)
    assert gate.cruise(GO, pose=at(9.99)).twist == GO
    gate.ask(GO, pose=at(10.01))
    assert gate.state.stop == Stop(Reason.GEOFENCE)


@pytest.mark.parametrize(
    ("ahead", "left", "inside"),
    [
        (2.9, 1.9, True),
        (2.9, -0.9, True),
        (-0.9, -0.9, True),
        (-0.9, 1.9, True),
        (3.1, 0.0, False),
        (-1.1, 0.0, False),
        (0.0, 2.1, False),
        (0.0, -1.1, False),
        (math.nan, 0.0, False),
        (0.0, math.nan, False),
    ],
)
@pytest.mark.parametrize("yaw", [0.0, math.pi / 2])
def test_a_polygon_stands_as_the_robot_stood(ahead, left, inside, yaw):
    gate = Gate(jumps=True, fence_corners_m=SQUARE, fence_radius_m=1.0)  # the polygon replaces the cylinder
    gate.ask(ZERO, pose=Pose(x=5.0, y=7.0, z=2.0, yaw=yaw))
    x, y = (ahead, left) if yaw == 0.0 else (-left, ahead)
    gate.ask(ZERO, pose=Pose(x=5.0 + x, y=7.0 + y, z=2.0, yaw=1.0))
    assert gate.state.stop == (None if inside else Stop(Reason.GEOFENCE))


@pytest.mark.parametrize(
    ("velocity", "yaw", "reach_m"),
    [
        (Twist(2.0), 0.0, 1.4),  # 2 m/s: 0.2 s late, then 2 m/s^2
        (Twist(0.0, 2.0), -math.pi / 2, 1.4),
        (Twist(-2.0), math.pi, 1.4),
        (Twist(2.0), math.pi / 2, 0.0),
        (Twist(-2.0), 0.0, -1.4),
    ],
)
def test_the_way_that_a_stop_needs_counts(velocity, yaw, reach_m):
    for margin_m, stop in ((0.01, None), (-0.01, Stop(Reason.GEOFENCE))):
        gate = Gate(jumps=True)
        gate.ask(ZERO, pose=Pose(z=2.0))
        aside = 0.0 if reach_m else math.sqrt(100.0 - (10.0 - 1.0) ** 2) - 1.4
        x = 9.0 if aside else 10.0 - reach_m
        gate.ask(ZERO, pose=Pose(x=x - margin_m, y=aside, z=2.0, yaw=yaw), velocity=velocity)
        assert gate.state.stop == stop


@pytest.mark.parametrize(("headway_s", "reach_m"), [(0.01, 0.26), (0.2, 0.45), (0.6, 0.85)])
def test_a_body_that_obeys_late_goes_on_at_its_speed_for_so_long(headway_s, reach_m):
    for margin_m, stop in ((0.01, None), (-0.01, Stop(Reason.GEOFENCE))):
        gate = Gate(jumps=True, headway_s=headway_s)
        gate.ask(ZERO, pose=Pose(z=2.0))
        gate.ask(ZERO, pose=Pose(x=10.0 - reach_m - margin_m, z=2.0), velocity=Twist(1.0))
        assert gate.state.stop == stop


def test_where_no_velocity_is_measured_what_was_sent_counts():
    gate = Gate(jumps=True)
    gate.cruise(Twist(1.0), pose=Pose(z=2.0), velocity=None)
    gate.ask(Twist(1.0), pose=Pose(x=9.54, z=2.0), velocity=None)
    assert gate.state.stop is None
    gate.ask(Twist(1.0), pose=Pose(x=9.56, z=2.0), velocity=None)
    assert gate.state.stop == Stop(Reason.GEOFENCE)


def test_a_position_that_comes_late_begins_the_fence_there():
    gate = Gate(jumps=True)
    gate.cruise(GO, pose=None)
    gate.ask(GO, pose=Pose(x=500.0, z=2.0))
    assert gate.state.start == Pose(x=500.0, z=2.0)
    gate.ask(GO, pose=Pose(x=511.0, z=2.0))
    assert gate.state.stop == Stop(Reason.GEOFENCE)


@pytest.mark.parametrize("height_m", [1.0 - STRAY_M, 6.0 + STRAY_M, math.nan])
def test_a_height_far_outside_the_band_stops(height_m):
    assert STRAY_M == 0.5
    if not math.isnan(height_m):
        assert stopped(Gate(jumps=True), pose=Pose(z=height_m)) is None
    outside = height_m + math.copysign(0.001, height_m - 3.0)
    assert stopped(Gate(jumps=True), pose=Pose(z=outside)) == Stop(Reason.ALTITUDE)


def test_a_robot_without_a_band_may_be_anywhere():
    assert stopped(Gate(jumps=True, altitude_m=None), pose=Pose(z=-50.0)) is None


@pytest.mark.parametrize(
    ("name", "robot"),
    [
        ("state_lost", {"t_ns": 0}),
        ("battery", {"battery": 0.0}),
        ("geofence", {"pose": Pose(x=1000.0, z=2.0)}),
        ("geofence", {"pose": Pose(z=2.0, yaw=math.inf), "velocity": Twist(1.0)}),
        ("altitude", {"pose": Pose(z=1000.0)}),
    ],
)
def test_what_the_profile_switches_off_does_not_stop(name, robot):
    assert stopped(Gate(jumps=True), **robot).reason == name
    gate = Gate(jumps=True, switched_off=(name,))
    assert stopped(gate, **robot) is None
    assert gate.ask(GO, **robot).warnings == ()


def test_what_the_robot_does_not_tell_stops_nothing_and_is_listed():
    silent = PlatformState(t_ns=1)
    gate = Gate()
    assert gate.cruise(GO, pose=None, velocity=None, battery=None).twist == GO
    assert gate.state.stop is None
    assert unmonitored(LIMITS, WELL) == ()
    assert unmonitored(LIMITS, silent) == (Reason.GEOFENCE, Reason.ALTITUDE, Reason.BATTERY)
    ground = Gate(altitude_m=None, switched_off=("battery",)).limits
    assert unmonitored(ground, silent) == (Reason.GEOFENCE,)
