"""The whole command follows a person with a ROS 2 robot, whose node is in another process."""

import pytest

pytest.importorskip("rclpy", reason="ROS 2 is not installed: pip install 'adatracker-deploy[ros2]'")

from tests.e2e.conftest import COMMAND, Flight

pytestmark = [pytest.mark.slow, pytest.mark.timeout(240)]


def test_a_ros_2_robot_follows_to_the_horizon(tmp_path, measured):
    run = Flight(
        [
            *(*COMMAND, "--platform", "ros2", "--sitl", "--segmenter", "truth"),
            *("--seed", "1", "--steps", "200", "--json"),
        ],
        tmp_path,
    )
    status, summary, err = run.end(timeout_s=120)
    assert status == 0, err
    assert (summary["outcome"], summary["el"]) == ("completed", 200)
    assert summary["mr"] >= 0.80
    assert summary["ar"] > 130  # the truth came beside the pictures
    measured(f"ros2: MR {summary['mr']:.3f}, AR {summary['ar']:.0f}, {summary['rate_hz']:.2f} Hz")
