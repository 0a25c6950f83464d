"""A camera over Zenoh for any robot: a real router, and messages laid out by hand."""

from __future__ import annotations

import contextlib
import socket
import struct
import threading
import time

import cv2
import numpy as np
import pytest
import zenoh
from hypothesis import given
from hypothesis import strategies as st
from streams import handles, until

from adatracker_deploy.core.clock import MonotonicClock
from adatracker_deploy.core.errors import PlatformError
from adatracker_deploy.core.ports import unused_port
from adatracker_deploy.perception.compressed_image import (
    IMAGE_CAP_BYTES,
    CompressedImage,
    read_compressed_image,
)
from adatracker_deploy.perception.jpeg import decode_jpeg
from adatracker_deploy.perception.sources import open_source
from adatracker_deploy.perception.zenoh_session import session_config
from tests.tiers import EXHAUSTIVE

pytestmark = pytest.mark.slow

CLOCK = MonotonicClock()
KEY = "front/image/compressed"


def message(data, *, stamp_ns=5_000_000_007, frame_id="lens", order="<"):
    """Lay out a CompressedImage: header, stamp, two texts padded to four bytes, the data."""
    encapsulation = b"\x00\x01\x00\x00" if order == "<" else bytes(4)
    body = struct.pack(order + "iI", stamp_ns // 10**9, stamp_ns % 10**9)
    for text in (frame_id.encode(), b"jpeg"):
        body += bytes(-len(body) % 4) + struct.pack(order + "I", len(text) + 1) + text + b"\0"
    return encapsulation + body + bytes(-len(body) % 4) + struct.pack(order + "I", len(data)) + data


# The message


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("frame_id", ["", "a", "abc", "abcd", "k\N{LATIN SMALL LETTER A WITH DIAERESIS}mera"])
def test_an_image_is_read_in_either_byte_order(order, frame_id):
    image = read_compressed_image(message(b"pixels", frame_id=frame_id, order=order))
    assert image == CompressedImage(5_000_000_007, "jpeg", memoryview(b"pixels"), frame_id)


@pytest.mark.parametrize(
    ("payload", "words"),
    [
        (b"", "plain CDR"),
        (b"\x00\x03" + message(b"pixels")[2:], "plain CDR"),
        (message(b"pixels")[:-1], "ends too soon"),
        (message(b"pixels") + bytes(4), "4 bytes behind it"),
        (message(b""), "without data"),
        (message(b"pixels", stamp_ns=-1), "no time has"),
        (message(b"x" * IMAGE_CAP_BYTES), "more than"),
    ],
)
def test_what_is_no_image_is_refused(payload, words):
    with pytest.raises(ValueError, match=words):
        read_compressed_image(payload)


@given(st.data())
def test_changed_and_cut_messages_are_images_or_refused(data):
    payload = bytearray(message(bytes(40)))
    for at in data.draw(st.lists(st.integers(0, len(payload) - 1), max_size=6)):
        payload[at] = data.draw(st.integers(0, 255))
    with contextlib.suppress(ValueError):
        image = read_compressed_image(bytes(payload[: data.draw(st.integers(0, len(payload)))]))
        assert 0 < len(image.data) <= len(payload)


# The camera


def free_port():
    return unused_port(socket.SOCK_STREAM)


def png(grey):
    return cv2.imencode(".png", np.full((24, 32, 3), grey, np.uint8))[1].tobytes()


class Robot:
    """A router with a camera, grey by its number."""

    def __init__(self, port):
        self.session = zenoh.open(session_config(f"tcp/127.0.0.1:{port}", mode="router"))
        self._publisher = self.session.declare_publisher(
            KEY, congestion_control=zenoh.CongestionControl.BLOCK
        )
        self.shots = 0

    def shoot(self, **how):
        self.shots += 1
        data = how.pop("data", None) or png(self.shots % 256)
        self.put(message(data, **{"stamp_ns": time.time_ns(), **how}))

    def put(self, payload):
        self._publisher.put(payload)


@pytest.fixture
def port():
    return free_port()


@pytest.fixture
def robot(port):
    robot = Robot(port)
    yield robot
    if not robot.session.is_closed():
        robot.session.close()


def seeing(robot, port, **how):
    camera = open_source(f"zenoh://127.0.0.1:{port}/{KEY}", CLOCK)
    opening = threading.Thread(target=camera.open)
    opening.start()
    until(lambda: robot.shoot(**how) or not opening.is_alive())
    return contextlib.closing(camera)


@pytest.fixture
def camera(robot, port):
    with seeing(robot, port) as camera:
        yield camera


@pytest.fixture
def unstamped(robot, port):
    with seeing(robot, port, stamp_ns=0) as camera:
        yield camera


def newest(camera):
    return camera.read(CLOCK.now_ns()) or camera.read(CLOCK.now_ns())


def test_the_newest_image_is_seen(camera, robot):
    for _ in range(5):
        robot.shoot()
    until(lambda: newest(camera).rgb[0, 0, 0] == robot.shots % 256)
    assert newest(camera).rgb.shape == (24, 32, 3)
    assert newest(camera).truth is None
    assert newest(camera).jpeg is None, "a PNG is none"


def test_a_jpeg_is_kept_as_it_came(camera, robot):
    jpeg = cv2.imencode(".jpg", np.full((24, 32, 3), 200, np.uint8))[1].tobytes()
    until(lambda: robot.shoot(data=jpeg) or newest(camera).jpeg == jpeg)
    assert np.array_equal(decode_jpeg(newest(camera).jpeg), newest(camera).rgb)


def test_rubbish_and_repeated_stamps_are_dropped_and_counted(camera, robot):
    until(lambda: newest(camera).rgb[0, 0, 0] == robot.shots % 256)
    last_ns = time.time_ns()
    robot.shoot(stamp_ns=last_ns)
    until(lambda: newest(camera).rgb[0, 0, 0] == robot.shots % 256)
    seen = newest(camera).seq
    for count, put in enumerate(
        (
            lambda: robot.put(b"rubbish"),
            lambda: robot.put(message(b"no image", stamp_ns=time.time_ns())),
            lambda: robot.put(message(png(3), stamp_ns=last_ns)),  # its stamp came before
            lambda: robot.put(message(png(4), stamp_ns=last_ns - 1)),  # and this is older
            lambda: robot.put(message(png(5), stamp_ns=last_ns - 2)),
        ),
        start=1,
    ):
        put()
        until(lambda count=count: camera.dropped == count)
    assert newest(camera).seq == seen
    robot.shoot()
    until(lambda: newest(camera).seq == seen + 1)
    assert not camera.hides_delay


@pytest.mark.parametrize("back_s", [0.01, 1e9])
def test_a_sender_whose_stamps_go_back_ends_the_camera_and_is_not_waited_for(camera, robot, back_s):
    """Its clock was set back, or it was started again and counts from when it was."""
    began_ns = time.time_ns() - round(back_s * 1e9)
    error = until(lambda: robot.shoot(stamp_ns=began_ns + robot.shots) or ended(camera))
    assert "its time stamps went back: it was restarted, or its clock was set" in error


def test_images_without_a_stamp_are_all_taken(unstamped, robot):
    camera = unstamped
    assert camera.hides_delay
    seen = newest(camera).seq
    robot.shoot(stamp_ns=0)
    until(lambda: newest(camera).seq > seen)
    seen = newest(camera).seq
    robot.shoot(stamp_ns=0)
    until(lambda: newest(camera).seq > seen)


def test_a_robot_that_goes_is_gone_at_once(camera, robot):
    robot.session.close()
    began_s = time.monotonic()
    assert "nothing answers at tcp/127" in until(lambda: ended(camera))
    assert time.monotonic() - began_s < 1.5


def ended(camera):
    """Return what ended it; empty while it goes on."""
    try:
        newest(camera)
    except PlatformError as error:
        return str(error)
    return ""


@EXHAUSTIVE
def test_a_topic_without_images_is_said_in_five_seconds(robot, port):
    camera = open_source(f"zenoh://127.0.0.1:{port}/rear/image", CLOCK)
    with pytest.raises(PlatformError, match="no picture came within 5 s"):
        camera.open()


def test_nobody_there_is_said_in_two_seconds(port):
    camera, began_s = open_source(f"zenoh://127.0.0.1:{port}/{KEY}", CLOCK), time.monotonic()
    with pytest.raises(PlatformError, match="no Zenoh router or bridge answers at tcp/127") as refusal:
        camera.open()
    assert time.monotonic() - began_s < 2.5
    assert "\n" not in str(refusal.value)


def test_thirty_cameras_one_after_the_other_leave_no_thread_and_no_file(robot, port):
    ended = threading.Event()

    def shoot():
        while not ended.wait(0.01):
            robot.shoot()

    shooting = threading.Thread(target=shoot, daemon=True)
    shooting.start()
    before = None
    for cycle in range(35):
        if cycle == 5:  # Zenoh's own threads have begun
            before = handles()
        camera = open_source(f"zenoh://127.0.0.1:{port}/{KEY}", CLOCK)
        camera.open()
        camera.close()
    ended.set()
    shooting.join()
    until(lambda: all(now <= then for now, then in zip(handles(), before, strict=True)))
