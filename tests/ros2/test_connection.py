"""The profile's section and the names that it makes; needs no ROS 2."""

import pytest

from adatracker_deploy.core.errors import UsageError
from adatracker_ros2.protocol.connection import Connection
from adatracker_ros2.protocol.topics import Topics

TOKEN = "0123456789abcdef" * 2


@pytest.mark.parametrize(
    ("wrong", "says"),
    [
        ({"command_topic": ""}, "command_topic is empty"),
        ({"odometry_topic": "/odom/"}, "'/odom/' is not a ROS 2 name"),
        ({"namespace": "robot 1"}, "'robot 1' is not a ROS 2 name"),
        ({"odometry_topic": "cmd_vel"}, "'cmd_vel' is named twice"),
        ({"peers": "192.168.1.20, 192.168.1.21"}, "are not addresses with semicolons between"),
        ({"timeout_parameter": "cmd_vel_timeout"}, "name driver_node too"),
        ({"lifecycle": True}, "name driver_node too"),
        ({"rehearsal_token": "mine"}, "rehearsal_token is set by --sitl"),
    ],
)
def test_what_cannot_be_is_refused_in_one_sentence(wrong, says):
    with pytest.raises(UsageError, match=says) as refused:
        Connection(**wrong)
    assert "\n" not in str(refused.value)


def test_names_are_expanded_as_ros_expands_them():
    topics = Topics(Connection(namespace="robot1", odometry_topic="/odom", driver_node="base"))
    assert (topics.command, topics.odometry, topics.driver) == ("/robot1/cmd_vel", "/odom", "/robot1/base")
    assert topics.battery == topics.camera == ""


def test_a_rehearsal_has_no_name_in_common_with_the_robot_that_it_stands_in_for():
    real = vars(Topics(Connection(odometry_topic="/odom", driver_node="/base")))
    rehearsal = vars(Topics(Connection(odometry_topic="/odom", driver_node="/base", rehearsal_token=TOKEN)))
    for name in ("command", "odometry", "driver", "truth", "go"):
        assert rehearsal[name] == f"/sitl_{TOKEN}{real[name]}"
