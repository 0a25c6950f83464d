"""The promises of every platform: over a virtual bus in one process, and over socketcand to another."""

import pytest

from adatracker_deploy.testing.conformance import PlatformConformance
from adatracker_wheeled.platform import WheeledPlatform
from wheeled_rig import InProcess, base_profile


class OnAVirtualBus(WheeledPlatform):
    @classmethod
    def sitl(cls, profile):
        return InProcess(profile)


class TestScoutOnAVirtualBus(PlatformConformance):
    platform_class = OnAVirtualBus
    clock_speed = 5.0

    @pytest.fixture(scope="class")
    @classmethod
    def profile(cls):
        return base_profile()


class TestOdriveOnAVirtualBus(TestScoutOnAVirtualBus):
    @pytest.fixture(scope="class")
    @classmethod
    def profile(cls):
        return base_profile("odrive_diff")


class TestScoutV1OnAVirtualBus(TestScoutOnAVirtualBus):
    @pytest.fixture(scope="class")
    @classmethod
    def profile(cls):
        return base_profile("scout_v1")


@pytest.mark.slow
class TestScoutInSitl(PlatformConformance):
    platform_class = WheeledPlatform
    clock_speed = 5.0
