"""Real simulators for camera tests: a server that says what a test tells it to, pictures, and waiting."""

from __future__ import annotations

import contextlib
import socket
import threading
import time
from pathlib import Path

import cv2
import numpy as np

STREAM = b"HTTP/1.0 200 OK\r\nContent-Type: multipart/x-mixed-replace; boundary=next\r\n\r\n"


def until(condition, timeout_s=10.0):
    """Return the condition's first true value."""
    deadline_s = time.monotonic() + timeout_s
    pause = threading.Event()
    while not (value := condition()):
        assert time.monotonic() < deadline_s, "what the test waits for did not happen"
        pause.wait(0.002)
    return value


def handles():
    """Return the numbers of this process's threads, OpenCV's and Zenoh's too, and of its open files."""
    return tuple(sum(1 for _ in Path(f"/proc/self/{what}").iterdir()) for what in ("task", "fd"))


def picture(seed=0, size=(48, 64)):
    """Return RGB noise of shape (*size, 3), smooth enough for JPEG to keep."""
    coarse = np.random.default_rng(seed).integers(0, 256, (6, 8, 3)).astype(np.uint8)
    return cv2.resize(coarse, size[::-1], interpolation=cv2.INTER_CUBIC)


def jpeg(rgb):
    return cv2.imencode(".jpg", cv2.cvtColor(rgb, cv2.COLOR_RGB2BGR))[1].tobytes()


def part(body, *headers):
    lines = (b"--next", b"Content-Type: image/jpeg", b"Content-Length: %d" % len(body), *headers)
    return b"\r\n".join((*lines, b"", body, b""))


@contextlib.contextmanager
def opening(make):
    """Give a function that opens the camera that `make` returns for its arguments; close all at the end."""
    with contextlib.ExitStack() as stack:

        def opened(*arguments, **how):
            camera = stack.enter_context(contextlib.closing(make(*arguments, **how)))
            camera.open()
            return camera

        yield opened


@contextlib.contextmanager
def serving(answer, *, needs_request=True):
    """Serve each connection with ``answer(connection, request)`` on a free port; gives that port.

    A connection that `answer` returned from stays open, silent, until the end.
    """
    listener = socket.create_server(("127.0.0.1", 0))
    connections = []

    def serve(connection):
        with contextlib.suppress(OSError):
            answer(connection, connection.recv(65536) if needs_request else b"")

    def accept():
        with contextlib.suppress(OSError):
            while True:
                connections.append(listener.accept()[0])
                threading.Thread(target=serve, args=connections[-1:], daemon=True).start()

    thread = threading.Thread(target=accept, daemon=True)
    thread.start()
    try:
        yield listener.getsockname()[1]
    finally:
        for each in (listener, *connections):
            with contextlib.suppress(OSError):
                each.shutdown(socket.SHUT_RDWR)
            each.close()
        thread.join(5)


def film(path, pictures, rate_hz=25.0):
    """Write an AVI of JPEGs by OpenCV's own writer, which leaves FFmpeg alone; returns its path."""
    height, width = pictures[0].shape[:2]
    codec = cv2.VideoWriter_fourcc(*"MJPG")
    writer = cv2.VideoWriter(str(path), cv2.CAP_OPENCV_MJPEG, codec, rate_hz, (width, height))
    for rgb in pictures:
        writer.write(cv2.cvtColor(rgb, cv2.COLOR_RGB2BGR))
    writer.release()
    return path
