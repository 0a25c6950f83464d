"""The same promises with the simulated vehicle in a thread of the same process."""

from __future__ import annotations

import threading

import pytest
from test_platform_sitl import AgainstTheManual, rehearsal_profile

from adatracker_deploy.platform import Sitl
from adatracker_deploy.sim.process import FaultCommands
from adatracker_drone.platform import DronePlatform
from adatracker_drone.sim.simulator import Simulator
from adatracker_drone.sim.sitl import DroneSitl
from tests.tiers import EXHAUSTIVE

pytestmark = [pytest.mark.slow, EXHAUSTIVE]  # `test_platform_sitl` has each promise on each run


class InAThread(Sitl):
    faults = DroneSitl.faults

    def __init__(self, profile):
        self._profile = profile
        self._ended = threading.Event()
        self._thread = None
        self._orders = FaultCommands()

    def order(self, line):
        self._orders.handle(line)

    def start(self, clock, scenario):
        port = int(self._profile.connection.url.rpartition(":")[2])
        simulator = Simulator(
            self._profile.sitl, scenario.seed, clock.speed, [("127.0.0.1", port)], orders=self._orders
        )
        self._thread = threading.Thread(target=simulator.serve, args=(clock, self._ended))
        self._thread.start()
        return self._profile

    def close(self):
        self._ended.set()
        if self._thread is not None:
            self._thread.join()


class InOneProcess(DronePlatform):
    @classmethod
    def sitl(cls, profile):
        return InAThread(profile)


class TestDroneInOneProcess(AgainstTheManual):
    platform_class = InOneProcess
    clock_speed = 3.0
    cruise_m_s = 1.0
    still_m_s = 0.5
    body_height_m = 2.0

    @pytest.fixture(scope="class")
    @classmethod
    def profile(cls):
        return rehearsal_profile()
