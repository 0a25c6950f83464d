"""The preflight's judgement of what was heard."""

import dataclasses
import math

import pytest

from adatracker_quadruped.adapter.preflight import RobotTelemetry, judge
from adatracker_quadruped.protocol.connection import Connection

FIT = RobotTelemetry(
    command_key="cmd_vel",
    matched=True,
    has_rival=False,
    trouble="",
    odometry_hz=50.0,
    attitude=(0.05, -0.1, 2.0),
    battery=0.8,
    camera_key="camera/image_raw/compressed",
    camera_heard=True,
    dropped=0,
)


def failed(connection=None, **changes):
    checks = judge(dataclasses.replace(FIT, **changes), connection or Connection())
    return {check.name: check for check in checks if not check.ok}


def test_a_fit_robot_passes_and_every_check_says_what_was_found():
    checks = judge(FIT, Connection())
    assert all(check.ok and check.message for check in checks)
    assert len(checks) == 7


def test_where_commands_carry_their_time_the_clocks_must_agree():
    stamped = Connection(command="twist_stamped")
    assert list(failed(stamped, clock_ahead_s=60.0)) == ["clocks"]
    assert failed(stamped, clock_ahead_s=0.01) == {}
    assert failed(clock_ahead_s=60.0) == {}  # a plain Twist carries none


@pytest.mark.parametrize(
    ("changes", "name", "says"),
    [
        ({"matched": False}, "command topic", "nobody subscribes to cmd_vel"),
        ({"has_rival": True}, "only host", "end the program"),
        ({"trouble": "no odometry for 0.40 s"}, "odometry", "no odometry for 0.40 s"),
        ({"odometry_hz": 9.0}, "odometry", "9 Hz; at least 10 Hz"),
        ({"attitude": (math.radians(85), 0.0, 0.0)}, "upright", "leans by 85 degrees"),
        ({"attitude": (0.0, math.radians(-35), 0.0)}, "upright", "leans by 35 degrees"),
        ({"attitude": None}, "upright", "no attitude"),
        ({"battery": 0.1}, "battery", "10%; charge it to 20% at least"),
        ({"battery": None}, "battery", "does not report its charge"),
    ],
)
def test_each_unfitness_refuses_by_its_name_and_says_what_to_do(changes, name, says):
    checks = failed(**changes)
    assert list(checks) == [name]
    assert checks[name].blocking
    assert says in checks[name].message


def test_a_robot_that_tells_no_charge_is_taken_when_the_profile_says_so():
    assert failed(Connection(min_battery=0.0), battery=None) == {}


def test_a_robot_that_walks_on_for_seconds_without_commands_is_refused():
    assert list(failed(Connection(command_timeout_s=2.0))) == ["command time-out"]


def test_a_silent_camera_and_malformed_messages_are_warned_of():
    checks = failed(camera_heard=False, dropped=3)
    assert sorted(checks) == ["camera topic", "messages"]
    assert not any(check.blocking for check in checks.values())
