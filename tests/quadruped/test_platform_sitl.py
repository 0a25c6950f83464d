"""The adapter against the simulated robot in its own process: each promise of `Platform`, in each dialect."""

import pytest

from adatracker_deploy.testing.conformance import PlatformConformance
from adatracker_quadruped.platform import QuadrupedPlatform
from tests.quadruped.rehearsal import rehearsed

pytestmark = pytest.mark.slow


class TestQuadrupedInSitl(PlatformConformance):
    platform_class = QuadrupedPlatform
    clock_speed = 5.0


class TestQuadrupedWithStampedCommandsOverRmwZenoh(TestQuadrupedInSitl):
    @pytest.fixture(scope="class")
    @classmethod
    def profile(cls):
        return rehearsed(
            dialect="rmw_zenoh", command="twist_stamped", namespace="robot1", robot_liveliness=""
        )


class TestQuadrupedBySportRequests(TestQuadrupedInSitl):
    @pytest.fixture(scope="class")
    @classmethod
    def profile(cls):
        return rehearsed(command="unitree_sport", command_topic="api/sport/request")
