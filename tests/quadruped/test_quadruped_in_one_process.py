"""The same promises with the simulated robot in a thread of the same process: two sessions."""

import dataclasses
import threading
from typing import ClassVar

import pytest

from adatracker_deploy.config.camera_topic import with_camera
from adatracker_deploy.platform import Sitl
from adatracker_deploy.sim.process import FaultCommands
from adatracker_deploy.testing.conformance import PlatformConformance
from adatracker_quadruped.platform import QuadrupedPlatform
from adatracker_quadruped.protocol.rehearsal_keys import ON_DEMAND
from adatracker_quadruped.sim.simulator import Robot, Simulator
from tests.quadruped.rehearsal import rehearsed
from tests.quadruped.routers import free_port
from tests.quadruped.test_platform_sitl import TWIST
from tests.tiers import EXHAUSTIVE

pytestmark = [pytest.mark.slow, EXHAUSTIVE]  # `test_platform_sitl` has each promise on each run


class InAThread(Sitl):
    faults = ON_DEMAND

    def __init__(self, profile):
        self._profile = profile
        self._ended = threading.Event()
        self._thread = None
        self._orders = FaultCommands()

    def order(self, line):
        self._orders.handle(line)

    def start(self, clock, scenario):
        connection = dataclasses.replace(with_camera(self._profile), endpoint=f"tcp/127.0.0.1:{free_port()}")
        robot = Robot(connection=connection, sitl=self._profile.sitl, camera_hz=1.0)  # nobody watches
        simulator = Simulator(robot, scenario, clock, self._orders)
        self._thread = threading.Thread(target=simulator.serve, args=(self._ended,))
        self._thread.start()
        return dataclasses.replace(self._profile, connection=connection)

    def close(self):
        self._ended.set()
        if self._thread is not None:
            self._thread.join()


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
