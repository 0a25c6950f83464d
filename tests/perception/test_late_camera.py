"""A network that passes pictures on more slowly than they are taken: nothing is driven by what is long past.

The cameras, the loop, the link and its gate are real; so are the sockets. Pictures come all the time, each
later than the one before.
"""

from __future__ import annotations

import contextlib
import threading
import time

import numpy as np
import pytest
import zenoh
from rtsp import rtsp_camera
from streams import STREAM, jpeg, part, picture, serving, until
from test_zenoh_camera import free_port, message

from adatracker_deploy.core.clock import MonotonicClock
from adatracker_deploy.core.errors import PlatformError
from adatracker_deploy.core.messages import ZERO, Action, Box, MaskClass, Observation
from adatracker_deploy.perception.pipeline import Perception
from adatracker_deploy.perception.sources import open_source
from adatracker_deploy.perception.zenoh_session import session_config
from adatracker_deploy.policy.base import FORWARD_YAW, PolicyInfo
from adatracker_deploy.runtime.link import RATE_HZ, Link, Phase
from adatracker_deploy.runtime.loop import Loop
from adatracker_deploy.testing.fake import FakePlatform, fake_profile
from tests.tiers import sampled

pytestmark = pytest.mark.timeout(60)

CLOCK = MonotonicClock()
CAMERA_HZ = 25.0
SLOWER = 4.0
"""A congested network passes on a quarter of what is taken."""
OTHER_CLOCK_NS = 1_700_000_000_000_000_000
LIMIT_S = 0.3
BUSY_S = 0.1
"""What two busy cores may add."""
PICTURES = [jpeg(picture(seed, (240, 320))) for seed in range(2, 10)]


class Congestion:
    """Passes pictures on as they are taken, and more slowly from `begin` on; the queue is endless."""

    def __init__(self) -> None:
        self.slow = threading.Event()
        self.ended = threading.Event()
        self.passed: list[tuple[float, float]] = []
        """When each picture was passed on, and when it had been taken."""

    def pictures(self):
        """Yield each picture with the time at which it was taken, s."""
        began_s = passes_s = time.monotonic()
        number = 0
        while not self.ended.is_set():
            taken_s = began_s + number / CAMERA_HZ
            passes_s = passes_s + SLOWER / CAMERA_HZ if self.slow.is_set() else taken_s
            self.ended.wait(max(0.0, passes_s - time.monotonic()))
            self.passed.append((time.monotonic(), taken_s))
            yield PICTURES[number % len(PICTURES)], taken_s
            number += 1

    def age_s(self, at_s):
        """Return the age of the newest picture that had been passed on by then."""
        return at_s - max(taken_s for passed_s, taken_s in list(self.passed) if passed_s <= at_s)


@contextlib.contextmanager
def mjpeg(congestion):
    def answer(connection, _):
        connection.sendall(STREAM)
        for data, taken_s in congestion.pictures():
            connection.sendall(part(data, b"X-Timestamp: %.6f" % (taken_s + OTHER_CLOCK_NS / 1e9)))

    with serving(answer) as port:
        yield f"http://127.0.0.1:{port}/"


@contextlib.contextmanager
def rtsp(congestion):
    with rtsp_camera((data for data, _ in congestion.pictures()), CAMERA_HZ, lambda _: None) as port:
        yield f"rtsp://127.0.0.1:{port}/eye"


@contextlib.contextmanager
def ros2(congestion):
    port = free_port()

    def publish(session):
        publisher = session.declare_publisher("eye", congestion_control=zenoh.CongestionControl.BLOCK)
        for data, taken_s in congestion.pictures():
            publisher.put(message(data, stamp_ns=round(taken_s * 1e9) + OTHER_CLOCK_NS))

    with zenoh.open(session_config(f"tcp/127.0.0.1:{port}", mode="router")) as session:
        publishing = threading.Thread(target=publish, args=(session,))
        publishing.start()
        yield f"zenoh://127.0.0.1:{port}/eye"
        congestion.ended.set()
        publishing.join()


class Seer:
    """Sees the target in every picture."""

    def __call__(self, frame):
        mask = np.full((8, 8), MaskClass.TARGET, np.uint8)
        return Observation(mask, Box(0.5, 0.5, 0.2, 0.4), 1.0, frame.t_ns, frame.seq)


class Ahead:
    """Always drives."""

    info = PolicyInfo(name="ahead", rate_hz=20.0, action=FORWARD_YAW)

    def reset(self, seed=0): ...

    def act(self, observation):
        return Action(np.array([0.5, 0.0], np.float32))


class Robot:
    """A link with its gate at its own rate; what moves is written down with its time."""

    def __init__(self) -> None:
        profile = fake_profile()
        self.limits, self.moving_s, self.reasons = profile.limits, [], set()
        platform = FakePlatform(profile, CLOCK)
        platform.connect()
        self._newest = None
        self._link = Link(platform, profile.limits, CLOCK, lambda: self._newest, spawn=lambda job: job())
        self._link.engage()
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def _run(self):
        while not self._ended.wait(1 / RATE_HZ):
            status = self._link.step(CLOCK.now_ns())
            if status.phase is Phase.ACTIVE and status.sent != ZERO:
                self.moving_s.append(time.monotonic())
            self.reasons.update(status.reasons)

    def send(self, setpoint):
        self._newest = setpoint

    def status(self):
        return self._link.status

    def alive(self):
        return True

    def close(self):
        self._ended.set()
        self._thread.join()


@pytest.mark.slow
@pytest.mark.parametrize("simulator", sampled((mjpeg, rtsp, ros2), everyday=(mjpeg,)))
def test_pictures_that_come_later_and_later_drive_nothing(simulator, measured):
    congestion = Congestion()
    with contextlib.ExitStack() as stack:
        stack.callback(congestion.ended.set)
        camera = open_source(stack.enter_context(simulator(congestion)), CLOCK)
        stack.callback(camera.close)
        camera.open()
        perception = stack.enter_context(Perception(camera, Seer(), CLOCK, 200.0))
        until(perception.newest)
        robot = stack.enter_context(contextlib.closing(Robot()))
        loop = Loop(
            observe=perception.newest,
            policy=Ahead(),
            link=robot,
            limits=robot.limits,
            clock=CLOCK,
            write=lambda *_: None,
        )
        following = threading.Thread(target=lambda: ends.append(ending(loop)))
        ends = []
        following.start()
        until(lambda: len(robot.moving_s) > 50)
        assert max(map(congestion.age_s, robot.moving_s[25:])) < LIMIT_S
        congestion.slow.set()
        slow_s = time.monotonic()
        until(lambda: ends or congestion.age_s(time.monotonic()) > 2.5, 20.0)
        following.join()
    worst_s = max(map(congestion.age_s, robot.moving_s))
    measured(f"late pictures, {simulator.__name__}: the oldest that moved {worst_s:.2f} s; then {ends[0]}")
    assert robot.moving_s[-1] > slow_s
    assert worst_s < LIMIT_S + BUSY_S


def ending(loop):
    """Return what ends it, in words."""
    try:
        return loop.run(600).reason
    except PlatformError as error:
        return str(error)
