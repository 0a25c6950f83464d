"""Wheeled bases keep every promise of `Platform`: on a virtual bus in-process, and over socketcand."""

import dataclasses
import math
from typing import ClassVar

import pytest
from wheeled_rig import InProcess, base_profile

from adatracker_deploy.core.messages import Twist
from adatracker_deploy.registry import load_profile
from adatracker_deploy.testing.conformance import PlatformConformance
from adatracker_wheeled.platform import WheeledPlatform
from tests.tiers import EXHAUSTIVE


class OnAVirtualBus(WheeledPlatform):
    @classmethod
    def sitl(cls, profile):
        return InProcess(profile)


class OnCan(PlatformConformance):
    """Conformance tests on CAN: the bytes sent are each frame's id, in two bytes, and its data."""

    says = "adatracker_wheeled.protocol.bus:Bus.send"

    def said(self, *values):
        frame = values[1]
        return frame.id.to_bytes(2, "big") + frame.data


V2 = {
    Twist(vx=0.15, yaw_rate=0.2): "0111 0096 00c8 0000 0000",  # thousandths, big-endian
    Twist(vx=-0.15, yaw_rate=-0.2): "0111 ff6a ff38 0000 0000",
}
"""AgileX's protocol v2, MotionCommand."""
V1 = {Twist(vx=0.75, yaw_rate=-0.26175): "0130 0100 32ce 0000"}
"""AgileX's protocol v1: CAN control, per cent of 1.5 m/s and of 0.5235 rad/s."""
TURN_S = 2 * math.pi * 0.085
"""Speed of a wheel that turns once a second, m/s."""
ODRIVE = {
    Twist(vx=TURN_S): ("000d 0000803f", "002d 000080bf"),  # the right motor is mounted the other way round
    Twist(yaw_rate=TURN_S / 0.4): ("000d 000000bf", "002d 000000bf"),
}
"""Set_Input_Vel of nodes 0 (left) and 1 (right): turns/s as IEEE 754, little-endian."""


@EXHAUSTIVE
class TestScoutOnAVirtualBus(OnCan):
    platform_class = OnAVirtualBus
    clock_speed = 5.0
    manual: ClassVar = V2

    @pytest.fixture(scope="class")
    @classmethod
    def profile(cls):
        return base_profile()


@EXHAUSTIVE
class TestOdriveOnAVirtualBus(TestScoutOnAVirtualBus):
    manual = ODRIVE

    @pytest.fixture(scope="class")
    @classmethod
    def profile(cls):
        return base_profile("odrive_diff")


@EXHAUSTIVE
class TestScoutV1OnAVirtualBus(TestScoutOnAVirtualBus):
    manual = V1

    @pytest.fixture(scope="class")
    @classmethod
    def profile(cls):
        return base_profile("scout_v1")


@pytest.mark.slow
class TestScoutInSitl(OnCan):
    platform_class = WheeledPlatform
    clock_speed = 2.0
    manual: ClassVar = V2

    @pytest.fixture(scope="class")
    @classmethod
    def profile(cls):
        """Return a profile with a slow camera: nobody watches, and rendering slows down a busy machine."""
        profile = load_profile("scout", WheeledPlatform)
        return dataclasses.replace(profile, camera=dataclasses.replace(profile.camera, rate_hz=1.0))
