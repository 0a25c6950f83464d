"""The same promises with the simulated vehicle in a thread of the same process."""

from __future__ import annotations

import pytest
from test_platform_sitl import AgainstTheManual, rehearsal_profile

from adatracker_drone.platform import DronePlatform
from adatracker_drone.sim.simulator import Simulator
from adatracker_drone.sim.sitl import DroneSitl
from tests.in_a_thread import SitlInAThread
from tests.tiers import EXHAUSTIVE

pytestmark = [pytest.mark.slow, EXHAUSTIVE]  # `test_platform_sitl` has each promise on each run


class InAThread(SitlInAThread):
    faults = DroneSitl.faults

    def start(self, clock, scenario):
        port = int(self._profile.connection.url.rpartition(":")[2])
        simulator = Simulator(
            self._profile.sitl, scenario.seed, clock.speed, [("127.0.0.1", port)], orders=self._orders
        )
        self.serve(simulator, clock)
        return self._profile


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
