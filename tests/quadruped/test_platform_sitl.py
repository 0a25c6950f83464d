"""The adapter against the simulated robot in its own process: each promise of `Platform`, in each dialect."""

from typing import ClassVar

import pytest

from adatracker_deploy.core.messages import Twist
from adatracker_deploy.testing.conformance import PlatformConformance
from adatracker_quadruped.platform import QuadrupedPlatform
from tests.quadruped.rehearsal import rehearsed
from tests.tiers import EXHAUSTIVE

pytestmark = pytest.mark.slow

TWIST = {Twist(vx=0.5, yaw_rate=0.25): "000000000000e03f" + "00" * 32 + "000000000000d03f"}
"""geometry_msgs/Twist in CDR: six IEEE 754 doubles, little-endian; linear x, y, z, angular x, y, z."""
SPORT = {Twist(vx=0.5, yaw_rate=0.25): b'{"x": 0.5, "y": 0.0, "z": 0.25}'.hex()}
"""The parameter of Unitree's Move, api id 1008."""


class TestQuadrupedInSitl(PlatformConformance):
    platform_class = QuadrupedPlatform
    clock_speed = 5.0
    manual: ClassVar = TWIST
    says = "adatracker_quadruped.protocol.publisher:Publisher.put"


@EXHAUSTIVE
class TestQuadrupedWithStampedCommandsOverRmwZenoh(TestQuadrupedInSitl):
    @pytest.fixture(scope="class")
    @classmethod
    def profile(cls):
        return rehearsed(
            dialect="rmw_zenoh", command="twist_stamped", namespace="robot1", robot_liveliness=""
        )


@EXHAUSTIVE
class TestQuadrupedBySportRequests(TestQuadrupedInSitl):
    manual = SPORT

    @pytest.fixture(scope="class")
    @classmethod
    def profile(cls):
        return rehearsed(command="unitree_sport", command_topic="api/sport/request")
