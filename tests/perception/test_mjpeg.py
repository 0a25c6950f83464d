"""A camera over HTTP: what it sends is seen fresh, and whatever is wrong with it is said in one sentence."""

from __future__ import annotations

import base64
import contextlib
import random
import threading
import time

import numpy as np
import pytest
from streams import STREAM, jpeg, opening, part, picture, serving, until

from adatracker_deploy.core.clock import MonotonicClock
from adatracker_deploy.core.errors import PlatformError
from adatracker_deploy.core.geometry import Pose
from adatracker_deploy.core.messages import Frame, Truth
from adatracker_deploy.perception import live, mjpeg
from adatracker_deploy.perception.jpeg import decode_jpeg
from adatracker_deploy.perception.mjpeg import MjpegCamera, decode_part
from adatracker_deploy.perception.mjpeg_server import MjpegServer
from adatracker_deploy.perception.multipart import LARGEST_BODY_BYTES, MultipartParser, Part
from adatracker_deploy.perception.truth_wire import encode_truth
from tests.kept import blocks_in_use
from tests.tiers import EXHAUSTIVE

CLOCK = MonotonicClock()
TRUTH = Truth(np.ones((48, 64), np.uint8), Pose(1.0), Pose(2.0), (3.0, 4.0), 5.0, 0.5)
ONE_PART = part(jpeg(picture()))


@pytest.fixture
def server():
    server = MjpegServer()
    yield server
    server.close()


@pytest.fixture
def opened():
    with opening(lambda url: MjpegCamera(url, CLOCK)) as opened:
        yield opened


def address(port, user=""):
    return f"http://{user}127.0.0.1:{port}/video?channel=1"


def saying(*pieces):
    return serving(lambda connection, _: [connection.sendall(piece) for piece in pieces])


def newest(camera):
    return camera.read(CLOCK.now_ns())


def error_of(camera):
    """Return what `read` raises sooner or later."""

    def error():
        try:
            newest(camera)
        except PlatformError as raised:
            return str(raised)
        return ""

    return until(error)


def test_a_published_frame_is_seen_with_its_truth_at_the_time_of_its_arrival(server, opened):
    server.publish(Frame(picture(7), 123, 77, TRUTH))
    before_ns = CLOCK.now_ns()
    frame = newest(opened(server.url))
    assert before_ns <= frame.t_ns <= CLOCK.now_ns()
    assert frame.seq == 1
    assert np.abs(frame.rgb.astype(int) - picture(7)).mean() < 5
    assert (frame.truth.robot, frame.truth.distance_m) == (TRUTH.robot, TRUTH.distance_m)
    assert np.array_equal(frame.truth.mask, TRUTH.mask)
    assert np.array_equal(decode_jpeg(frame.jpeg), frame.rgb)


def test_what_is_no_rehearsal_may_number_its_pictures_as_it_likes(server, opened):
    server.publish(Frame(picture(0), 0, 50))
    camera = opened(server.url)
    server.publish(Frame(picture(1), 0, 50))
    until(lambda: newest(camera).seq == 2)


@pytest.mark.parametrize(
    ("text", "stamp_ns"),
    [
        ("1732291200.000001", 1_732_291_200_000_001_000),  # ROS web_video_server
        ("12.000345", 12_000_345_000),  # ESP32, since it was switched on
        ("7", 7_000_000_000),
        ("0.000000", 0),
        *((text, 0) for text in ("", "-1.0", "nan", "1e400", "1.", "9" * 400, "1.0 x", "12:30", "\u0661")),
    ],
)
def test_a_time_stamp_is_read_or_is_none(text, stamp_ns):
    assert decode_part(Part({"x-timestamp": text}, jpeg(picture())), 5).stamp_ns == stamp_ns


@pytest.mark.parametrize("speed", [0.5, 3.0])
def test_at_any_speed_a_rehearsals_pictures_are_no_older_than_they_are(server, speed):
    clock = MonotonicClock(speed)
    server.publish(Frame(picture(0), clock.now_ns(), 1, TRUTH))
    camera = MjpegCamera(server.url, clock)
    with contextlib.closing(camera):
        camera.open()
        for seq in range(2, 30):
            server.publish(Frame(picture(seq), clock.now_ns(), seq, TRUTH))
            seen = until(lambda seq=seq: (frame := camera.read(clock.now_ns())).seq == seq and frame)
        assert (clock.now_ns() - seen.t_ns) / 1e9 / speed < 0.2
        assert not camera.hides_delay


def test_a_camera_that_does_not_say_when_its_pictures_were_taken_is_known_to_hide_delay(opened):
    with saying(STREAM, ONE_PART, ONE_PART) as port:
        assert opened(address(port)).hides_delay


def test_frames_are_numbered_by_the_camera_and_never_from_the_future(server, opened):
    server.publish(Frame(picture(0), 0, 50))
    camera = opened(server.url)
    first = newest(camera)
    server.publish(Frame(picture(1), 0, 90))
    second = until(lambda: (frame := newest(camera)).seq == 2 and frame)
    assert camera.read(second.t_ns - 1) is first
    assert camera.read(first.t_ns - 1) is None
    assert first.truth is second.truth is None


def test_people_are_told_to_go_through_the_same_server_and_only_in_a_rehearsal(server, opened):
    went = threading.Event()
    server.on_go(went.set)
    server.publish(Frame(picture(0), 0, 1))
    camera = opened(server.url)
    camera.go()
    assert not went.is_set()
    server.publish(Frame(picture(1), 0, 2, TRUTH))
    until(lambda: newest(camera).truth)
    camera.go()
    assert went.is_set()


def test_a_rehearsal_that_does_not_take_the_go_is_an_error(opened):
    def answer(connection, request):
        if request.startswith(b"GET"):
            truth = base64.b64encode(encode_truth(TRUTH))
            connection.sendall(STREAM + part(jpeg(picture()), b"X-Truth: " + truth))
        else:
            connection.sendall(b"HTTP/1.0 503 Busy\r\n\r\n")

    with serving(answer) as port, pytest.raises(PlatformError, match="cannot begin: POST /go answered 503"):
        opened(address(port)).go()


@pytest.mark.parametrize(
    ("answer", "sentence"),
    [
        (b"HTTP/1.0 404 Not Found\r\n\r\n", "answered 404 Not Found"),
        (
            b"HTTP/1.0 200 OK\r\nContent-Type: text/html\r\n\r\n",
            "sends text/html, expected a multipart stream",
        ),
        (b"HTTP/1.0 401 No\r\n\r\n", "wants a user: write http://USER:PASSWORD@"),
        (STREAM.replace(b"; boundary=next", b""), "names no boundary"),
        (b"SSH-2.0-OpenSSH_9.6\r\n", "its answer is not HTTP: .*SSH-2.0"),
        (b"", "its answer is not HTTP: RemoteDisconnected"),
        (STREAM, "the stream has ended"),
        (STREAM + b"--next\r\nContent-Length: %d\r\n\r\n" % (LARGEST_BODY_BYTES + 1), "length is"),
        (STREAM + b"x" * 200_000, "no boundary came"),
    ],
)
def test_what_is_no_stream_is_said_in_one_sentence(answer, sentence, opened):
    def say(connection, _):
        connection.sendall(answer)
        connection.close()

    with (
        serving(say) as port,
        pytest.raises(PlatformError, match=f"^camera http://127.*{sentence}") as raised,
    ):
        opened(address(port))
    assert "\n" not in str(raised.value)


def test_nobody_there_is_said_at_once(opened):
    with serving(lambda *_: None) as port:
        pass
    with pytest.raises(PlatformError, match=r"camera http://127.0.0.1:\d+/\S+: Connection refused"):
        opened(address(port))


@pytest.mark.parametrize("pieces", [(), (STREAM,), (STREAM, ONE_PART[:-40])])
def test_a_camera_that_stays_silent_is_given_up(pieces, opened, monkeypatch):
    monkeypatch.setattr(live, "OPEN_TIMEOUT_S", 0.3)
    with saying(*pieces) as port, pytest.raises(PlatformError, match=r"no picture came within 0\.3 s"):
        opened(address(port))
    until(lambda: not any(thread.name.startswith("camera") for thread in threading.enumerate()))


def test_a_silent_camera_is_said_to_be_so_too_where_its_socket_gives_up_before_us(opened, monkeypatch):
    monkeypatch.setattr(mjpeg, "OPEN_TIMEOUT_S", 0.1)
    with saying() as port, pytest.raises(PlatformError, match="no picture came within 5 s"):
        opened(address(port))


def test_a_camera_that_falls_silent_later_is_told_by_the_time_of_its_last_frame(opened):
    with saying(STREAM, ONE_PART) as port:
        camera = opened(address(port))
        with pytest.raises(PlatformError, match="no picture has come for"):
            camera.read(CLOCK.now_ns() + 2_100_000_000)


def test_a_stream_that_ends_is_an_error_from_then_on(server, opened):
    server.publish(Frame(picture(), 0, 1))
    camera = opened(server.url)
    server.close()
    assert error_of(camera) == f"camera {server.url}: the stream has ended"
    assert error_of(camera) == f"camera {server.url}: the stream has ended"


def test_a_size_that_changes_ends_the_camera(server, opened):
    server.publish(Frame(picture(), 0, 1))
    camera = opened(server.url)
    server.publish(Frame(picture(size=(60, 80)), 0, 2))
    assert "size changed from 64x48 to 80x60" in error_of(camera)


def test_a_picture_that_repeats_is_as_old_as_the_first_of_its_kind(server, opened):
    server.publish(Frame(picture(), 0, 1))
    camera = opened(server.url)
    first = newest(camera)
    for number in range(2, 5):
        last = camera._watch._last
        server.publish(Frame(picture(), 0, number))
        until(lambda last=last: camera._watch._last is not last)  # it came
        assert newest(camera) is first
    server.publish(Frame(picture(1), 0, 9))
    assert until(lambda: (frame := newest(camera)) is not first and frame).seq == 2


@pytest.mark.parametrize(
    "damaged",
    [
        part(b"no picture"),
        part(b""),
        part(jpeg(picture())[:-40]),
        part(jpeg(picture()), b"X-Truth: !"),
        part(jpeg(picture()), b"X-Truth: AAAA"),
    ],
)
def test_a_damaged_picture_is_dropped_and_counted_and_the_next_one_seen(damaged, opened):
    go_on = threading.Event()

    def say(connection, _):
        connection.sendall(STREAM + damaged)
        go_on.wait(10)
        connection.sendall(ONE_PART)

    with serving(say) as port:
        camera = MjpegCamera(address(port), CLOCK)
        opening = threading.Thread(target=camera.open)
        opening.start()
        until(lambda: camera.dropped == 1)
        go_on.set()
        opening.join()
        assert newest(camera).seq == 1
        camera.close()


def test_of_a_backlog_only_the_newest_picture_is_looked_at(opened, monkeypatch):
    monkeypatch.setattr(mjpeg, "_RECEIVE_BYTES", 4096)  # less than a picture, as TLS hands it over
    backlog = [part(jpeg(picture(seed, (240, 320)))) for seed in range(150)]
    with saying(STREAM + b"".join(backlog)) as port:
        camera = opened(address(port))
        last = picture(149, (240, 320)).astype(int)
        until(lambda: np.abs(newest(camera).rgb - last).mean() < 5)
        assert newest(camera).seq < 50


def test_bodies_without_a_length_and_chunked_transfer_are_understood(opened):
    bare = b"--next\r\nContent-Type: image/jpeg\r\n\r\n" + jpeg(picture(3)) + b"\r\n--next\r\n"
    chunks = b"".join(
        b"%x\r\n%s\r\n" % (len(bare[i : i + 100]), bare[i : i + 100]) for i in range(0, len(bare), 100)
    )
    head = STREAM.replace(b"HTTP/1.0", b"HTTP/1.1").replace(
        b"\r\n\r\n", b"\r\nTransfer-Encoding: chunked\r\n\r\n"
    )
    with saying(head, chunks) as port:
        assert np.abs(newest(opened(address(port))).rgb.astype(int) - picture(3)).mean() < 5


def test_the_password_is_sent_and_never_shown(opened):
    heard = []

    def answer(connection, request):
        heard.append(request)
        connection.sendall(STREAM + ONE_PART)

    with serving(answer) as port:
        camera = opened(address(port, "guard:p%40ss@"))
    message = error_of(camera)
    assert b"GET /video?channel=1 HTTP" in heard[0]
    assert b"Authorization: Basic " + base64.b64encode(b"guard:p@ss") in heard[0]
    assert "guard" not in message
    assert "ss@" not in message


def test_a_plain_server_behind_https_is_said_to_be_one(opened):
    with (
        saying(b"HTTP/1.0 400 Bad Request\r\n\r\n") as port,
        pytest.raises(PlatformError, match="camera https"),
    ):
        opened(address(port).replace("http", "https"))


def test_closing_ends_the_reader_at_once_even_while_the_camera_is_silent():
    with saying(STREAM, ONE_PART) as port:
        camera = MjpegCamera(address(port), CLOCK)
        camera.open()
        began_s = time.monotonic()
        camera.close()
        camera.close()
        assert time.monotonic() - began_s < 1.0
        assert not any(thread.name == f"camera {camera.name}" for thread in threading.enumerate())


def test_a_camera_that_was_never_opened_can_be_closed():
    MjpegCamera("http://127.0.0.1:9/", CLOCK).close()


@EXHAUSTIVE
@pytest.mark.slow
def test_a_hundred_thousand_damaged_parts_break_nothing_and_leave_nothing_behind():
    rng, body = random.Random(0), jpeg(picture(size=(16, 16)))
    wholes = [part(body)] * 9 + [part(body, b"X-Truth: " + base64.b64encode(encode_truth(TRUTH)))]
    parser, refused = MultipartParser("next"), 0
    before = blocks_in_use()
    for number in range(100_000):
        damaged = bytearray(wholes[number % len(wholes)])
        for _ in range(3):
            damaged[rng.randrange(len(damaged))] = rng.randrange(256)
        try:
            for each in parser.feed(bytes(damaged[: rng.randrange(len(damaged) // 2, 2 * len(damaged))])):
                decode_part(each, number)
        except ValueError:
            parser, refused = MultipartParser("next"), refused + 1
    assert blocks_in_use() - before < 10_000
    assert 1000 < refused < 100_000
