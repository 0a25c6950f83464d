"""Live video through OpenCV: an RTSP camera, and an AVI that a server sends bit by bit."""

from __future__ import annotations

import threading
import time
from itertools import cycle, takewhile

import numpy as np
import pytest
from rtsp import rtsp_camera
from streams import film, jpeg, opening, picture, serving, until

from adatracker_deploy.core.clock import MonotonicClock
from adatracker_deploy.core.errors import PlatformError
from adatracker_deploy.perception import frame_monitor, live
from adatracker_deploy.perception.video import VideoCamera

pytestmark = pytest.mark.slow

CLOCK = MonotonicClock()
PAUSE = threading.Event()
AT_ONCE = 60
"""Frames that come before the first pause: as many as OpenCV wants to look at before it opens a stream."""


@pytest.fixture
def opened():
    with opening(lambda uri: VideoCamera(uri, CLOCK)) as opened:
        yield opened


def sending(path, go_on, *, then_hang_up=True):
    """Serve half of a film at once, the rest when `go_on` is set."""
    data = path.read_bytes()

    def send(connection, _):
        connection.sendall(data[: len(data) // 2])
        go_on.wait(10)
        connection.sendall(data[len(data) // 2 :])
        if then_hang_up:
            connection.close()

    return serving(send, needs_request=False)


def newest(camera):
    return camera.read(CLOCK.now_ns())


def test_the_newest_frame_of_a_stream_is_seen_at_the_time_of_its_arrival(opened, tmp_path):
    path, go_on = film(tmp_path / "live.avi", [picture(i) for i in range(2 * AT_ONCE)]), threading.Event()
    with sending(path, go_on, then_hang_up=False) as port:  # else its end may be read before its newest frame
        before_ns = CLOCK.now_ns()
        camera = opened(f"tcp://127.0.0.1:{port}")
        early = until(lambda: (frame := newest(camera)).seq > AT_ONCE // 2 and frame)
        assert np.abs(early.rgb.astype(int) - picture(early.seq - 1)).mean() < 10
        go_on.set()
        late = until(lambda: (frame := newest(camera)).seq > AT_ONCE + 5 and frame)
        assert before_ns < early.t_ns < late.t_ns <= CLOCK.now_ns()
        camera.close()


def test_an_rtsp_camera_is_seen_as_it_is_and_told_when_it_falls_silent(opened):
    ended, shown = threading.Event(), [picture(seed, (240, 320)) for seed in range(8)]
    with rtsp_camera(
        takewhile(lambda _: not ended.is_set(), cycle(map(jpeg, shown))), 50, PAUSE.wait
    ) as port:
        camera = opened(f"rtsp://127.0.0.1:{port}/eye")
        seen = [
            until(lambda number=number: (frame := newest(camera)).seq > number and frame)
            for number in (5, 60)
        ]
        ended.set()
        for frame in seen:
            assert min(np.abs(frame.rgb.astype(int) - rgb).mean() for rgb in shown) < 3
        with pytest.raises(PlatformError, match="no picture has come for"):
            until(lambda: camera.read(newest(camera).t_ns + 2_100_000_000) is None)


def test_closing_ends_the_reader_of_a_stream_that_goes_on(opened):
    with rtsp_camera(cycle([jpeg(picture(0)), jpeg(picture(1))]), 50, PAUSE.wait) as port:
        camera = opened(f"rtsp://127.0.0.1:{port}/eye")
        camera.close()
        camera.close()
        assert not any(camera.name in thread.name for thread in threading.enumerate())


def test_a_stream_that_ends_is_an_error(opened, tmp_path):
    path, go_on = film(tmp_path / "live.avi", [picture(i) for i in range(AT_ONCE)]), threading.Event()
    with sending(path, go_on) as port:
        camera = opened(f"tcp://127.0.0.1:{port}")
        go_on.set()
        with pytest.raises(PlatformError, match="the stream has ended"):
            until(lambda: newest(camera) is None)


def test_a_live_camera_that_shows_one_and_the_same_picture_is_frozen(opened, tmp_path, monkeypatch):
    path, go_on = film(tmp_path / "live.avi", [picture()] * 2 * AT_ONCE), threading.Event()
    monkeypatch.setattr(frame_monitor, "FROZEN_AFTER_S", 0.1)
    with sending(path, go_on, then_hang_up=False) as port:
        camera = opened(f"tcp://127.0.0.1:{port}")
        until(lambda: CLOCK.now_ns() > newest(camera).t_ns + 150_000_000)
        go_on.set()
        with pytest.raises(PlatformError, match=r"the very same picture for 0\.\d s: it hangs or is covered"):
            until(lambda: newest(camera) is None)


@pytest.mark.parametrize("scheme", ["rtsp", "rtsps"])
def test_a_stream_that_nobody_serves_is_said_to_be_so_at_once(opened, scheme):
    with serving(lambda *_: None) as port:
        pass
    with pytest.raises(PlatformError, match=rf"camera {scheme}://127.0.0.1:{port}/cam: Connection refused"):
        opened(f"{scheme}://guard:secret@127.0.0.1:{port}/cam")


def test_a_door_behind_which_nobody_speaks_is_given_up_within_five_seconds(opened, capfd):
    began_s = time.monotonic()
    either = (
        "cannot be opened as a video|no picture came within 5 s"  # OpenCV's time-out ends just before ours
    )
    with serving(lambda *_: None) as port, pytest.raises(PlatformError, match=either):
        opened(f"rtsp://127.0.0.1:{port}/cam")
    assert time.monotonic() - began_s < live.OPEN_TIMEOUT_S + live._JOIN_TIMEOUT_S
    assert capfd.readouterr() == ("", "")


def test_opening_does_not_wait_for_opencv(opened, monkeypatch):
    monkeypatch.setattr(live, "OPEN_TIMEOUT_S", 0.3)
    monkeypatch.setattr(live, "_JOIN_TIMEOUT_S", 0.1)
    began_s = time.monotonic()
    with (
        serving(lambda *_: None) as port,
        pytest.raises(PlatformError, match=r"no picture came within 0\.3 s"),
    ):
        opened(f"rtsp://127.0.0.1:{port}/cam")
    assert time.monotonic() - began_s < 1.0


@pytest.mark.parametrize("answer", [b"RTSP/1.0 404 Not Found\r\nCSeq: 1\r\n\r\n", b"\0" * 1000])
def test_a_server_without_the_video_is_said_to_have_none(opened, answer):
    def say(connection, _):
        connection.sendall(answer)
        connection.close()

    with serving(say) as port, pytest.raises(PlatformError, match="cannot be opened as a video"):
        opened(f"rtsp://127.0.0.1:{port}/cam")


def test_a_device_that_is_no_camera_is_said_to_be_none(opened, capfd):
    with pytest.raises(PlatformError, match="camera /dev/null: cannot be opened as a video"):
        opened("/dev/null")
    assert capfd.readouterr() == ("", "")
