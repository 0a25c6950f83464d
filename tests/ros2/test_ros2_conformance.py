"""The adapter keeps each promise of `Platform`, against the simulated robot's node in another process."""

import dataclasses
from typing import ClassVar

import pytest

from tests.tiers import EXHAUSTIVE

pytest.importorskip("rclpy", reason="ROS 2 is not installed: pip install 'adatracker-deploy[ros2]'")
from rclpy.serialization import serialize_message

from adatracker_deploy.core.messages import Twist
from adatracker_deploy.registry import load_profile
from adatracker_deploy.testing.conformance import PlatformConformance
from adatracker_ros2.platform import Ros2Platform

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
    @classmethod
    def profile(cls):
        return cls.seldom_drawn()

    @staticmethod
    def seldom_drawn(**connection):
        """Return a profile with a slow camera: nobody watches, and rendering slows down a busy machine."""
        profile = load_profile("ros2_robot", Ros2Platform)
        return dataclasses.replace(
            profile,
            camera=dataclasses.replace(profile.camera, rate_hz=1.0),
            connection=dataclasses.replace(profile.connection, **connection),
        )


@EXHAUSTIVE
class TestAManagedNodeInANamespaceThatTakesTwistStamped(TestRos2InSitl):
    @pytest.fixture(scope="class")
    @classmethod
    def profile(cls):
        return cls.seldom_drawn(
            command="twist_stamped",
            command_topic="/base/cmd_vel",
            namespace="robot1",
            odometry_velocity="odom",
            lifecycle=True,
        )
