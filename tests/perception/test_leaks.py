"""Perception that goes on for hours keeps nothing: neither memory, nor threads, nor files."""

from __future__ import annotations

import contextlib
import itertools
import os
import socket
import threading
from pathlib import Path

import cv2
import pytest
from streams import film, handles, picture, until

from adatracker_deploy.core.camera import FilmOverError
from adatracker_deploy.core.clock import FakeClock, MonotonicClock
from adatracker_deploy.core.messages import Frame
from adatracker_deploy.perception.mjpeg_server import MjpegServer
from adatracker_deploy.perception.models.catalogue import open_model
from adatracker_deploy.perception.pipeline import Perception
from adatracker_deploy.perception.sources import FileCamera, open_source
from adatracker_deploy.perception.target_segmenter import TargetSegmenter
from tests.e2e.painted import painted, red_detector
from tests.tiers import EXHAUSTIVE

WARM, FRAMES = 500, 1500
KEPT_MIB = 24
"""What may be kept of a thousand frames; pictures and masks alone would be 80."""
CYCLES, WARM_CYCLES = 30, 5


def resident_mib() -> float:
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 2**20


class Weighed:
    """A segmenter; notes the process's memory when it is warm and every 500 frames later."""

    def __init__(self, segmenter):
        self.segmenter = segmenter
        self.resident_mib = []
        self.seen = 0

    def __call__(self, frame):
        observation = self.segmenter(frame)
        self.seen += observation.box is not None
        if frame.seq % WARM == 0:
            self.resident_mib.append(resident_mib())
        return observation


@EXHAUSTIVE
@pytest.mark.slow
def test_a_thousand_frames_leave_nothing_behind(tmp_path, measured):
    path = film(tmp_path / "person.avi", [painted(number, (120, 160)) for number in range(FRAMES)])
    detector = red_detector(tmp_path / "red.onnx")
    segmenter = Weighed(TargetSegmenter(open_model(detector, ["person"], None), None))
    camera = FileCamera(path, every_frame=True)
    camera.open()
    with contextlib.closing(camera), Perception(camera, segmenter, FakeClock(), 20.0) as perception:

        def over():
            try:
                perception.newest()
            except FilmOverError:
                return True
            return False

        until(over, timeout_s=150)
    warm, *_, last = segmenter.resident_mib
    measured(f"perception, frames {WARM} to {FRAMES}: resident memory {warm:.0f} to {last:.0f} MiB")
    assert segmenter.seen > 0.95 * FRAMES  # the lock, looks and the camera's motion were at work
    assert last - warm < KEPT_MIB


@contextlib.contextmanager
def file(folder):
    yield str(film(folder / "film.avi", [picture(seed) for seed in range(3)]))


@contextlib.contextmanager
def photographs(folder):
    for seed in range(3):
        cv2.imwrite(str(folder / f"{seed}.png"), picture(seed))
    yield str(folder)


@contextlib.contextmanager
def mjpeg(folder):
    server, ended = MjpegServer(), threading.Event()

    def publish():  # and so it finds out who is gone
        for seq in itertools.count(1):
            server.publish(Frame(picture(seq % 9), 0, seq))
            if ended.wait(0.01):
                return

    thread = threading.Thread(target=publish, daemon=True)
    thread.start()
    yield server.url
    ended.set()
    thread.join()
    server.close()


@contextlib.contextmanager
def stream(folder):
    """An AVI to whoever asks, by TCP."""
    data = film(folder / "film.avi", [picture(seed) for seed in range(70)]).read_bytes()
    listener = socket.create_server(("127.0.0.1", 0))

    def serve():
        with contextlib.suppress(OSError):
            while True:
                connection, _ = listener.accept()
                with connection, contextlib.suppress(OSError):
                    connection.sendall(data)

    thread = threading.Thread(target=serve, daemon=True)
    thread.start()
    yield f"tcp://127.0.0.1:{listener.getsockname()[1]}"
    listener.shutdown(socket.SHUT_RDWR)
    thread.join(10)
    listener.close()


@pytest.mark.parametrize("source", [file, photographs, mjpeg, stream])
def test_a_camera_that_is_opened_and_closed_thirty_times_holds_nothing(source, tmp_path):
    clock = MonotonicClock()

    def cycle(uri):
        camera = open_source(uri, clock)
        camera.open()
        until(lambda: camera.read(clock.now_ns()))
        camera.close()

    with source(tmp_path) as uri:
        for _ in range(WARM_CYCLES):
            cycle(uri)
        before = handles()
        for _ in range(CYCLES):
            cycle(uri)
        until(lambda: all(now <= then for now, then in zip(handles(), before, strict=True)))
