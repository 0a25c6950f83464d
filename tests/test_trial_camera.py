"""A rehearsal waits for its simulator's first picture; a silent real camera is given up after one attempt."""

from __future__ import annotations

import contextlib
import threading

import numpy as np
import pytest

from adatracker_deploy.app import trial_camera
from adatracker_deploy.app.trial_camera import opened
from adatracker_deploy.core.clock import MonotonicClock
from adatracker_deploy.core.errors import PlatformError
from adatracker_deploy.core.messages import Frame
from adatracker_deploy.perception import live
from adatracker_deploy.perception.mjpeg_server import MjpegServer
from adatracker_deploy.perception.sources import open_source

CLOCK = MonotonicClock()


@pytest.fixture(autouse=True)
def impatient(monkeypatch):
    for module in (live, trial_camera):
        monkeypatch.setattr(module, "OPEN_TIMEOUT_S", 0.3)


@pytest.fixture
def server():
    server = MjpegServer()
    yield server
    server.close()


@pytest.fixture
def making(server):
    """Give a function that opens the server's stream as a camera; as a list it holds those it opened."""

    class Making(list):
        def __call__(self):
            self.append(open_source(server.url, CLOCK))
            return self[-1]

    return Making()


def test_a_simulated_camera_whose_first_picture_takes_long_is_waited_for(server, making):
    """The first picture comes only after the first attempt to open the camera has timed out."""
    over = threading.Event()

    def draw():
        while not over.wait(0.05):
            if len(making) > 1:
                server.publish(Frame(np.zeros((24, 32, 3), np.uint8), CLOCK.now_ns(), 1))

    drawing = threading.Thread(target=draw)
    drawing.start()
    try:
        with contextlib.ExitStack() as stack:
            camera = opened(making, stack, 20.0)
            assert camera.read(CLOCK.now_ns()).rgb.shape == (24, 32, 3)
    finally:
        over.set()
        drawing.join()
    assert len(making) > 1


@pytest.mark.parametrize(("patience_s", "least", "most"), [(0.0, 1, 1), (0.5, 2, 3)])
def test_one_that_stays_silent_is_given_up(making, patience_s, least, most):
    with contextlib.ExitStack() as stack, pytest.raises(PlatformError, match="no picture came within"):
        opened(making, stack, patience_s)
    assert least <= len(making) <= most


def test_one_that_says_what_is_wrong_is_not_asked_again(server, making):
    server.close()
    with contextlib.ExitStack() as stack, pytest.raises(PlatformError, match="Connection refused"):
        opened(making, stack, 60.0)
    assert len(making) == 1
