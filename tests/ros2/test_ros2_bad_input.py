"""A topic of another type or quality of service: one sentence and exit status 2, and nothing moves."""

import contextlib
import dataclasses
import itertools

import pytest
import yaml

pytest.importorskip("rclpy", reason="ROS 2 is not installed: pip install 'adatracker-deploy[ros2]'")

import rclpy.node

from adatracker_deploy.cli import main
from adatracker_deploy.core.clock import MonotonicClock
from adatracker_deploy.core.errors import PlatformError, UsageError
from adatracker_deploy.registry import profile_dir
from adatracker_ros2.adapter.graph import UNNAMED
from adatracker_ros2.platform import Ros2Platform
from adatracker_ros2.protocol.connection import Qos
from adatracker_ros2.protocol.topics import BATTERY_STATE, Topics
from tests.ros2.rehearsal import adapter, changed, publisher, rehearsed, simulator

SOON_S = 3.0
LOOKS_WITHOUT_A_NAME = 40


@pytest.fixture(scope="module")
def robot():
    with simulator(rehearsed()) as (_, profile):
        yield changed(profile, connect_timeout_s=SOON_S)


@pytest.mark.parametrize(
    ("connection", "says"),
    [
        ({"command": "twist_stamped"}, "cmd_vel is geometry_msgs/msg/Twist at /sitl_"),
        ({"odometry_topic": "cmd_vel2", "battery_topic": "odom"}, "odom is nav_msgs/msg/Odometry at /sitl_"),
        (
            {"odometry_qos": Qos(reliability="reliable", durability="transient_local")},
            "odom is published volatile, but asked for transient local",
        ),
    ],
)
def test_a_topic_with_another_type_or_quality_is_the_profiles_fault(robot, connection, says):
    with adapter(changed(robot, **connection)) as platform:
        with pytest.raises(UsageError, match=says) as refused:
            platform.connect()
        assert "\n" not in str(refused.value)
        assert not platform.state().engaged


def test_odometry_that_nobody_publishes_is_named(robot):
    says = r"no odometry came on /sitl_.*/nobodys in domain"
    with (
        adapter(changed(robot, odometry_topic="nobodys")) as platform,
        pytest.raises(PlatformError, match=says),
    ):
        platform.connect()


def test_a_time_out_that_the_driver_tells_otherwise_is_refused(robot):
    with adapter(changed(robot, command_timeout_s=0.4, connect_timeout_s=5.0)) as platform:
        platform.connect()
        [check] = [check for check in platform.preflight() if not check.ok]
        assert (check.name, check.blocking) == ("command time-out", True)
        assert "cmd_vel_timeout of base_controller is 0.5 s" in check.message


def test_a_camera_topic_that_carries_no_images_is_named(robot):
    elsewhere = dataclasses.replace(robot, camera=dataclasses.replace(robot.camera, uri="robot://battery2"))
    topic = Topics(changed(robot, camera_topic="battery2").connection).camera
    with publisher(robot.connection, "battery_driver", topic, BATTERY_STATE):
        camera = type(platform_of(robot)).camera(elsewhere, platform_of(robot).clock)
        with pytest.raises(UsageError, match="is sensor_msgs/msg/BatteryState at /battery_driver"):
            camera.open()


def test_a_refusal_waits_for_the_name_of_a_node_and_a_camera_does_not(robot, monkeypatch):
    """A node's name follows its topics in the graph, on a busy machine by more than 0.3 s."""
    looks = itertools.count()
    told = rclpy.node.Node.get_publishers_info_by_topic

    def nameless(node, topic):
        there = told(node, topic)
        if there and next(looks) < LOOKS_WITHOUT_A_NAME:
            for endpoint in there:
                endpoint.node_name = UNNAMED
        return there

    monkeypatch.setattr(rclpy.node.Node, "get_publishers_info_by_topic", nameless)
    test_a_camera_topic_that_carries_no_images_is_named(robot)
    assert next(looks) > LOOKS_WITHOUT_A_NAME
    looks = itertools.count()
    with contextlib.closing(Ros2Platform.camera(robot, MonotonicClock())) as camera:
        camera.open()
    assert next(looks) < LOOKS_WITHOUT_A_NAME


def platform_of(profile):
    with adapter(profile) as platform:
        return platform


@pytest.mark.slow
def test_a_run_against_another_type_ends_with_status_2_and_one_line(robot, tmp_path, capsys, monkeypatch):
    """The whole command against the robot in the other process, as one with a wrong profile would give it."""
    profile = yaml.safe_load((profile_dir() / "ros2_robot.yaml").read_text(encoding="utf-8"))
    connection = robot.connection
    profile["connection"] |= {
        "command": "twist_stamped",
        "domain": connection.domain,
        "discovery": "localhost",
        "rehearsal_token": connection.rehearsal_token,
    }
    path = tmp_path / "mine.yaml"
    path.write_text(yaml.safe_dump(profile), encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    status = main(
        ["--platform", "ros2", "--profile", str(path), "--camera", "world://simple_room", "--steps", "5"]
    )
    err = capsys.readouterr().err
    assert status == 2, err
    assert [line for line in err.splitlines() if "cmd_vel is geometry_msgs/msg/Twist at" in line]
