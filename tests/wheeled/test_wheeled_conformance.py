"""The promises of every platform: over a virtual bus in one process, and over socketcand to another."""

import dataclasses

import pytest
from wheeled_rig import InProcess, base_profile

from adatracker_deploy.profile import load_profile
from adatracker_deploy.testing.conformance import PlatformConformance
from adatracker_wheeled.platform import WheeledPlatform


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
    clock_speed = 2.0

    @pytest.fixture(scope="class")
    @classmethod
    def profile(cls):
        """Draw seldom: nobody watches, and on a busy machine it takes the time of all the rest."""
        profile = load_profile("scout", WheeledPlatform)
        return dataclasses.replace(profile, camera=dataclasses.replace(profile.camera, rate_hz=1.0))
