"""The simulated base's camera freezes and goes away when that is ordered, and whoever looks notices."""

from __future__ import annotations

import contextlib

import numpy as np
import pytest

from adatracker_deploy.core.clock import MonotonicClock
from adatracker_deploy.core.errors import PlatformError
from adatracker_deploy.core.geometry import Pose
from adatracker_deploy.core.messages import Frame, Truth
from adatracker_deploy.perception.frame_monitor import SILENT_AFTER_S
from adatracker_deploy.perception.mjpeg import MjpegCamera
from adatracker_wheeled.sim.camera import FailingCamera

CLOCK = MonotonicClock()
TRUTH = Truth(np.ones((8, 8), np.uint8), Pose(), Pose(), (3.0, 4.0), 5.0, 0.5)


def frame(seq):
    return Frame(np.full((48, 64, 3), seq, np.uint8), CLOCK.now_ns(), seq, TRUTH)


@pytest.fixture
def served():
    """Give the camera's simulator and what a tracker reads it with."""
    with contextlib.closing(FailingCamera(0, lambda: None)) as simulator:
        simulator.publish(frame(1))
        with contextlib.closing(MjpegCamera(simulator.url, CLOCK)) as camera:
            camera.open()
            yield simulator, camera


def publish_until(simulator, seqs, condition):
    """Publish again and again, as a film does, until the condition holds."""
    for seq in seqs:
        simulator.publish(frame(seq))
        if found := condition():
            return found
    return pytest.fail("it never came")


def read_for_ever(camera):
    while True:
        camera.read(CLOCK.now_ns())


def shades(camera):
    newest = camera.read(CLOCK.now_ns())
    return newest.rgb[0, 0, 0], newest.seq


def test_a_frozen_camera_shows_nothing_new_until_it_is_silent_for_good(served):
    simulator, camera = served
    before = shades(camera)
    simulator.apply_faults(frozenset({"camera_freeze"}))

    def silent():
        try:
            assert shades(camera) == before
        except PlatformError as error:
            return str(error)
        return ""

    numbers = iter(range(2, 10_000_000))
    assert f"no picture has come for {SILENT_AFTER_S:.0f}" in publish_until(
        simulator, (min(next(numbers), 200) for _ in iter(int, 1)), silent
    )


def test_a_camera_that_thaws_shows_what_there_is_now(served):
    simulator, camera = served
    simulator.apply_faults(frozenset({"camera_freeze"}))
    simulator.publish(frame(100))
    simulator.apply_faults(frozenset())
    publish_until(simulator, iter(lambda: 200, 0), lambda: shades(camera)[0] > 190)


def test_a_camera_that_goes_ends_the_stream_and_comes_back_at_the_same_address(served):
    simulator, camera = served
    url = simulator.url
    simulator.apply_faults(frozenset({"camera_gone"}))
    simulator.publish(frame(2))  # to nobody
    with pytest.raises(PlatformError, match="the stream has ended"):
        read_for_ever(camera)
    simulator.apply_faults(frozenset())
    assert simulator.url == url
    simulator.publish(frame(3))
    with contextlib.closing(MjpegCamera(url, CLOCK)) as again:
        again.open()
        assert again.read(CLOCK.now_ns()).truth is not None
    with pytest.raises(PlatformError, match="the stream has ended"):
        camera.read(CLOCK.now_ns())  # the old one does not come back
