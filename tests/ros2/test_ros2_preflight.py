"""The ROS 2 preflight judges what it heard from the robot; these tests need no ROS 2."""

import dataclasses
import math

import pytest

from adatracker_deploy.core.camera_info import CameraInfo
from adatracker_ros2.adapter.preflight import RobotTelemetry, judge
from adatracker_ros2.protocol.connection import Connection

GOOD = RobotTelemetry(
    command_topic="/cmd_vel",
    matched=True,
    rival="",
    trouble="",
    odometry_hz=50.0,
    battery=0.8,
    timeout_s=0.5,
    state="active",
    camera_topic="/camera",
    camera_there=True,
    dropped=0,
)
ASKED = Connection(driver_node="base", timeout_parameter="cmd_vel_timeout", lifecycle=True, min_battery=0.2)


LENS = CameraInfo(width_px=640, height_px=480, fx=462.0, fy=462.0, cx=320.0, cy=240.0)  # 69 degrees
CALIBRATED = {"camera_info_topic": "/camera/camera_info", "camera_info_came": True, "lens": LENS}


def bad(connection=ASKED, fov_deg=None, **heard):
    checks = judge(dataclasses.replace(GOOD, **heard), connection, fov_deg)
    return [check for check in checks if not check.ok]


def test_a_robot_that_is_as_it_should_be_passes():
    assert bad() == []


@pytest.mark.parametrize(
    ("heard", "name", "says"),
    [
        ({"matched": False}, "command topic", "nobody subscribes to /cmd_vel"),
        ({"rival": "/teleop publishes to /cmd_vel too"}, "only publisher", "/teleop publishes"),
        ({"odometry_hz": 9.0}, "odometry", "9 Hz; at least 10 Hz"),
        ({"trouble": "no odometry for 0.40 s"}, "odometry", "no odometry for 0.40 s"),
        ({"battery": 0.1}, "battery", "charge it to 20%"),
        ({"battery": None}, "battery", "does not report its charge"),
        ({"timeout_s": None}, "command time-out", "is unknown"),
        ({"timeout_s": 0.0}, "command time-out", "is 0 s: set it to 1 s or less, and above 0"),
        ({"timeout_s": math.nan}, "command time-out", "is nan s"),
        ({"timeout_s": 5.0}, "command time-out", "is 5 s: set it to 1 s or less"),
        ({"timeout_s": 0.25}, "command time-out", "is 0.25 s, but command_timeout_s is 0.5"),
        ({"state": "inactive"}, "driver", "is inactive: ros2 lifecycle set base activate"),
        ({"state": None}, "driver", "does not report its state"),
    ],
)
def test_what_is_wrong_blocks_and_is_named(heard, name, says):
    [check] = bad(**heard)
    assert (check.name, check.blocking) == (name, True)
    assert says in check.message


def test_a_camera_that_nobody_publishes_and_odd_messages_are_told_only():
    assert [check.blocking for check in bad(camera_there=False)] == [False]
    assert [check.blocking for check in bad(dropped=3)] == [False]


def test_a_robot_whose_driver_is_not_asked_is_taken_at_its_profiles_word():
    assert bad(Connection(), timeout_s=None, state=None) == []
    [check] = bad(Connection(command_timeout_s=2.0), timeout_s=None)
    assert check.name == "command time-out"


def test_where_commands_carry_their_time_the_clocks_must_agree():
    stamped = dataclasses.replace(ASKED, command="twist_stamped")
    assert [check.name for check in bad(stamped, clock_ahead_s=60.0)] == ["clocks"]
    assert bad(stamped, clock_ahead_s=0.01) == []
    assert bad(clock_ahead_s=60.0) == []  # a plain Twist carries none


def lens(fov_deg=None, **heard):
    checks = judge(dataclasses.replace(GOOD, **heard), ASKED, fov_deg)
    return next((check for check in checks if check.name == "lens"), None)


def test_the_lens_is_read_where_the_camera_tells_it():
    assert lens() is None  # nobody publishes camera_info: a policy needs none
    assert lens(**CALIBRATED).message == "69 degrees by /camera/camera_info (fx 462 of 640 px)"
    assert "is not calibrated" in lens(**CALIBRATED | {"lens": None}).message


@pytest.mark.parametrize("said", [67.9, 69.4, 71.3])
def test_a_profile_that_agrees_with_camera_info_passes(said):
    assert bad(fov_deg=said, **CALIBRATED) == []


def test_a_profile_that_disagrees_with_camera_info_is_told_in_a_sentence_and_may_go_on():
    [check] = bad(fov_deg=90.0, **CALIBRATED)
    assert (check.name, check.blocking) == ("lens", False)
    assert check.message == (
        "camera.fov_deg is 90 in the profile, but 69 degrees by /camera/camera_info (fx 462 of 640 px): "
        "correct one, or leave it out"
    )


def test_camera_info_of_another_type_or_without_sense_is_told_and_may_go_on():
    [check] = bad(**CALIBRATED | {"camera_info_came": False, "lens": None})
    assert (check.name, check.blocking) == ("lens", False)
    assert "no valid sensor_msgs/CameraInfo came" in check.message
