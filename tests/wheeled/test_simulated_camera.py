"""The simulated base's camera freezes and goes away when that is ordered, and whoever looks notices."""

from __future__ import annotations

import contextlib

import numpy as np
import pytest

from adatracker_deploy.core.clock import MonotonicClock
from adatracker_deploy.core.errors import PlatformError
from adatracker_deploy.core.geometry import Pose
from adatracker_deploy.core.messages import Frame, Truth
from adatracker_deploy.perception.mjpeg import MjpegCamera
from adatracker_deploy.perception.watch import SILENT_AFTER_S
from adatracker_wheeled.sim.camera import FailingCamera

CLOCK = MonotonicClock()
TRUTH = Truth(np.ones((8, 8), np.uint8), Pose(), Pose(), (3.0, 4.0), 5.0, 0.5, collided=False)


def frame(seq):
    return Frame(np.full((48, 64, 3), seq, np.uint8), CLOCK.now_ns(), seq, TRUTH)


@pytest.fixture
def served():
    """Give the camera's far end and what a tracker reads it with."""
    with contextlib.closing(FailingCamera(0, lambda: None)) as far_end:
        far_end.publish(frame(1))
        with contextlib.closing(MjpegCamera(far_end.url, CLOCK)) as camera:
            camera.open()
            yield far_end, camera


def publish_until(far_end, seqs, condition):
    """Publish again and again, as a film does, until the condition holds."""
    for seq in seqs:
        far_end.publish(frame(seq))
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
    far_end, camera = served
    before = shades(camera)
    far_end.suffer(frozenset({"camera_freeze"}))

    def silent():
        try:
            assert shades(camera) == before
        except PlatformError as error:
            return str(error)
        return ""

    numbers = iter(range(2, 10_000_000))
    assert f"no picture has come for {SILENT_AFTER_S:.0f}" in publish_until(
        far_end, (min(next(numbers), 200) for _ in iter(int, 1)), silent
    )


def test_a_camera_that_thaws_shows_what_there_is_now(served):
    far_end, camera = served
    far_end.suffer(frozenset({"camera_freeze"}))
    far_end.publish(frame(100))
    far_end.suffer(frozenset())
    publish_until(far_end, iter(lambda: 200, 0), lambda: shades(camera)[0] > 190)


def test_a_camera_that_goes_ends_the_stream_and_comes_back_at_the_same_address(served):
    far_end, camera = served
    url = far_end.url
    far_end.suffer(frozenset({"camera_gone"}))
    far_end.publish(frame(2))  # to nobody
    with pytest.raises(PlatformError, match="the stream has ended"):
        read_for_ever(camera)
    far_end.suffer(frozenset())
    assert far_end.url == url
    far_end.publish(frame(3))
    with contextlib.closing(MjpegCamera(url, CLOCK)) as again:
        again.open()
        assert again.read(CLOCK.now_ns()).truth is not None
    with pytest.raises(PlatformError, match="the stream has ended"):
        camera.read(CLOCK.now_ns())  # the old one does not come back
