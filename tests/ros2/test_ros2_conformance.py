"""The adapter keeps each promise of `Platform`, against the simulated robot's node in another process."""

from typing import ClassVar

import pytest

from tests.tiers import EXHAUSTIVE

pytest.importorskip("rclpy", reason="ROS 2 is not installed: pip install 'adatracker-deploy[ros2]'")
from rclpy.serialization import serialize_message

from adatracker_deploy.core.messages import Twist
from adatracker_deploy.testing.conformance import PlatformConformance
from adatracker_ros2.platform import Ros2Platform
from tests.ros2.rehearsal import rehearsed

pytestmark = pytest.mark.slow

TWIST = {Twist(vx=0.5, yaw_rate=0.25): "000000000000e03f" + "00" * 32 + "000000000000d03f"}
"""geometry_msgs/Twist in CDR: six IEEE 754 doubles, little-endian; linear x, y, z, angular x, y, z."""


class TestRos2InSitl(PlatformConformance):
    platform_class = Ros2Platform
    clock_speed = 2.0
    manual: ClassVar = TWIST
    says = "adatracker_ros2.adapter.command_publisher:write_command"

    def said(self, *values):
        """Return the message as serialized by rclpy, which is what goes out."""
        return serialize_message(values[-1])

    @pytest.fixture(scope="class")
    @staticmethod
    def profile():
        return rehearsed()


@EXHAUSTIVE
class TestAManagedNodeInANamespaceThatTakesTwistStamped(TestRos2InSitl):
    @pytest.fixture(scope="class")
    @staticmethod
    def profile():
        return rehearsed(
            command="twist_stamped",
            command_topic="/base/cmd_vel",
            namespace="robot1",
            odometry_velocity="odom",
            lifecycle=True,
        )
