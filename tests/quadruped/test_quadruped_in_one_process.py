"""The same promises with the simulated robot in a thread of the same process: two sessions."""

import dataclasses
import threading

import pytest

from adatracker_deploy.platform import Sitl
from adatracker_deploy.testing.conformance import PlatformConformance
from adatracker_quadruped.camera_topic import with_camera
from adatracker_quadruped.far_end import FarEnd, Robot
from adatracker_quadruped.platform import QuadrupedPlatform
from tests.quadruped.rehearsal import rehearsed
from tests.quadruped.routers import free_port

pytestmark = pytest.mark.slow


class InAThread(Sitl):
    def __init__(self, profile):
        self._profile = profile
        self._ended = threading.Event()
        self._thread = None

    def start(self, clock, scenario):
        connection = dataclasses.replace(with_camera(self._profile), endpoint=f"tcp/127.0.0.1:{free_port()}")
        robot = Robot(connection=connection, sitl=self._profile.sitl, camera_hz=1.0)  # nobody watches
        far_end = FarEnd(robot, scenario, clock)
        self._thread = threading.Thread(target=far_end.serve, args=(self._ended,))
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

    @pytest.fixture(scope="class")
    @classmethod
    def profile(cls):
        return rehearsed()
