"""The same promises with the simulated robot in a thread of the same process: two sessions."""

import dataclasses
from typing import ClassVar

import pytest

from adatracker_deploy.config.camera_topic import with_camera
from adatracker_deploy.testing.conformance import PlatformConformance
from adatracker_quadruped.platform import QuadrupedPlatform
from adatracker_quadruped.protocol.rehearsal_keys import ON_DEMAND
from adatracker_quadruped.sim.simulator import Robot, Simulator
from tests.in_a_thread import SitlInAThread
from tests.quadruped.rehearsal import rehearsed
from tests.quadruped.routers import free_port
from tests.quadruped.test_platform_sitl import TWIST
from tests.tiers import EXHAUSTIVE

pytestmark = [pytest.mark.slow, EXHAUSTIVE]  # `test_platform_sitl` has each promise on each run


class InAThread(SitlInAThread):
    faults = ON_DEMAND

    def start(self, clock, scenario):
        connection = dataclasses.replace(with_camera(self._profile), endpoint=f"tcp/127.0.0.1:{free_port()}")
        robot = Robot(connection=connection, sitl=self._profile.sitl, camera_hz=1.0)  # nobody watches
        self.serve(Simulator(robot, scenario, clock, self._orders))
        return dataclasses.replace(self._profile, connection=connection)


class InOneProcess(QuadrupedPlatform):
    @classmethod
    def sitl(cls, profile):
        return InAThread(profile)


class TestQuadrupedInOneProcess(PlatformConformance):
    platform_class = InOneProcess
    clock_speed = 2.0
    manual: ClassVar = TWIST
    says = "adatracker_quadruped.protocol.publisher:Publisher.put"

    @pytest.fixture(scope="class")
    @classmethod
    def profile(cls):
        return rehearsed()
