"""The whole command follows a person with a ROS 2 robot, whose node is in another process."""

import pytest

from tests.tiers import EXHAUSTIVE

pytest.importorskip("rclpy", reason="ROS 2 is not installed: pip install 'adatracker-deploy[ros2]'")

from tests.e2e.conftest import follow_to_the_horizon

pytestmark = [pytest.mark.slow, pytest.mark.timeout(240)]


@EXHAUSTIVE
def test_a_ros_2_robot_follows_to_the_horizon(tmp_path, measured):
    summary = follow_to_the_horizon("ros2", tmp_path)
    measured(f"ros2: MR {summary['mr']:.3f}, AR {summary['ar']:.0f}, {summary['rate_hz']:.2f} Hz")
