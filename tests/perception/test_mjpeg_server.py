"""The simulator's stream: anybody can watch, nobody delays it, and it says what a part is."""

from __future__ import annotations

import base64
import contextlib
import http.client
import re
import socket
import threading
import time
import urllib.error
import urllib.request

import cv2
import numpy as np
import pytest

from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.core.geometry import Pose
from adatracker_deploy.core.messages import Frame, Truth
from adatracker_deploy.page.loopback import MAX_CONNECTIONS
from adatracker_deploy.perception import mjpeg_server
from adatracker_deploy.perception.capture import Capture
from adatracker_deploy.perception.jpeg import decode_jpeg
from adatracker_deploy.perception.mjpeg_server import MjpegServer
from adatracker_deploy.perception.multipart import MultipartParser
from adatracker_deploy.perception.truth_wire import decode_truth

TRUTH = Truth(np.ones((8, 8), np.uint8), Pose(1.0), Pose(2.0), (3.0, 4.0), 5.0, 0.5, contact="an obstacle")


@pytest.fixture
def server():
    server = MjpegServer()
    yield server
    server.close()


def frame(seq, size=(48, 64), truth=None):
    return Frame(np.full((*size, 3), (seq % 256, 40, 200), np.uint8), seq * 1_500_000_000, seq, truth)


def noise(seq, size):
    rgb = np.random.default_rng(seq).integers(0, 256, (*size, 3)).astype(np.uint8)
    return Frame(rgb, seq, seq)


@contextlib.contextmanager
def watching(server, path="/stream.mjpg"):
    """Give a function that returns the stream's next part."""
    connection = http.client.HTTPConnection("127.0.0.1", server.port, timeout=10)
    connection.request("GET", path)
    response = connection.getresponse()
    parser, waiting = MultipartParser(response.headers.get_boundary()), []

    def next_part():
        while not waiting:
            data = response.read1(1 << 16)
            assert data, "the stream has ended"
            waiting.extend(parser.feed(data))
        return waiting.pop(0)

    yield next_part
    response.close()
    connection.close()


def test_a_part_says_what_it_is_when_it_was_taken_and_which_one_it_is(server):
    server.publish(frame(3, truth=TRUTH))
    with watching(server) as next_part:
        headers, body = next_part()
    assert headers["content-type"] == "image/jpeg"
    assert int(headers["content-length"]) == len(body)
    assert headers["x-timestamp"] == "4.500000"
    assert headers["x-sequence"] == "3"
    assert decode_truth(base64.b64decode(headers["x-truth"])).target_xy == TRUTH.target_xy
    assert np.abs(decode_jpeg(body).astype(int) - frame(3).rgb).max() < 10


def test_outside_a_rehearsal_there_is_no_truth(server):
    server.publish(frame(1))
    with watching(server) as next_part:
        assert "x-truth" not in next_part().headers


def test_whoever_types_no_path_sees_the_same(server):
    server.publish(frame(1))
    with watching(server) as named, watching(server, "/") as unnamed:
        assert named() == unnamed()


def test_every_watcher_sees_what_is_published_and_it_is_encoded_once(server, monkeypatch):
    encoded, encode = [], cv2.imencode
    monkeypatch.setattr(mjpeg_server.cv2, "imencode", lambda *args: encoded.append(1) or encode(*args))
    server.publish(frame(1))
    server.publish(frame(2))
    assert not encoded
    with watching(server) as one, watching(server) as other:
        for seq in (2, 3, 4):
            if seq > 2:
                server.publish(frame(seq))
            assert one() == other()
    assert len(encoded) == 3


def test_any_program_can_watch_with_a_truth_as_large_as_they_come(server):
    busy = np.random.default_rng(0).integers(0, 4, (240, 320)).astype(np.uint8)
    truth = Truth(busy[:160, :160], Pose(), Pose(), (0.0, 0.0), 1.0, 0.0)
    ended = threading.Event()

    def film():
        for seq in range(1, 10_000):
            server.publish(frame(seq, truth=truth))
            if ended.wait(0.01):
                return

    thread = threading.Thread(target=film)
    thread.start()
    try:
        video = Capture(server.url)  # FFmpeg's own reader of such streams
        assert video.grab()
        assert video.rgb().shape == (48, 64, 3)
        video.close()
    finally:
        ended.set()
        thread.join()


def test_a_client_that_does_not_read_delays_nobody_and_is_shown_the_present_later(server):
    pictures = [noise(seq, (240, 320)) for seq in range(4)]
    server.publish(pictures[0])
    with watching(server) as slow, watching(server) as quick:
        slow()
        quick()
        took_s = []
        for seq in range(1, 101):  # some 6 MB, far more than the kernel keeps
            began_s = time.perf_counter()
            server.publish(Frame(pictures[seq % 4].rgb, seq, seq))
            took_s.append(time.perf_counter() - began_s)
            while int(quick().headers["x-sequence"]) < seq:
                pass
        assert sorted(took_s)[50] < 0.002
        seen = [0]
        while seen[-1] < 100:
            seen.append(int(slow().headers["x-sequence"]))
        assert len(seen) < 20
        assert seen == sorted(set(seen))


def test_clients_that_have_left_keep_nobody_out(server):
    for _ in range(MAX_CONNECTIONS):
        with watching(server):
            pass  # no picture is sent, so the server does not know yet that it has left
    ended = threading.Event()

    def publish():
        seq = 0
        while not ended.wait(0.02):
            server.publish(frame(seq := seq + 1))

    publishing = threading.Thread(target=publish)
    publishing.start()
    try:
        with watching(server) as next_part:
            assert decode_jpeg(next_part().body).shape == (48, 64, 3)
    finally:
        ended.set()
        publishing.join()


def test_whoever_posts_go_lets_the_people_walk(server):
    went = []
    server.on_go(lambda: went.append("people"))
    server.on_go(lambda: went.append("clock"))
    request = urllib.request.Request(f"http://127.0.0.1:{server.port}/go", method="POST")
    with urllib.request.urlopen(request, timeout=5) as response:
        assert response.status == 204
    assert went == ["people", "clock"]


@pytest.mark.parametrize(("path", "method"), [("/index.html", "GET"), ("/go", "GET"), ("/stop", "POST")])
def test_anything_else_is_not_found(server, path, method):
    request = urllib.request.Request(f"http://127.0.0.1:{server.port}{path}", method=method)
    with pytest.raises(urllib.error.HTTPError, match="404"):
        urllib.request.urlopen(request, timeout=5)


def test_a_port_in_use_is_said_to_be(server):
    with pytest.raises(UsageError, match=f"TCP port {server.port} for the camera's stream: .*in use"):
        MjpegServer(server.port)


def test_closing_ends_every_stream_and_frees_the_port():
    server = MjpegServer()
    server.publish(frame(1))
    with watching(server) as next_part:
        next_part()
        server.close()
        server.close()
        with pytest.raises(AssertionError, match="has ended"):
            next_part()
    MjpegServer(server.port).close()


def test_closing_does_not_wait_for_a_client_that_does_not_read():
    others = set(threading.enumerate())  # servers of other tests may still serve
    server = MjpegServer()
    server.publish(noise(0, (720, 1280)))  # more than the kernel keeps
    with socket.socket() as client:
        client.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        client.connect(("127.0.0.1", server.port))
        client.sendall(b"GET /stream.mjpg HTTP/1.0\r\n\r\n")
        received = b""
        while b"--frame" not in received:
            received += client.recv(64)
        server.close()
        deadline_s = time.monotonic() + mjpeg_server._SEND_TIMEOUT_S / 2
        while any("process_request_thread" in thread.name for thread in set(threading.enumerate()) - others):
            assert time.monotonic() < deadline_s


def test_rubbish_requests_change_nothing(server):
    for rubbish in (b"\0\xff" * 40_000, b"GET\r\n\r\n", b"POST /go HTTP/9.9\r\n\r\n"):
        connection = socket.create_connection(("127.0.0.1", server.port), 5)
        with connection, contextlib.suppress(OSError):  # it may hang up before it has read everything
            connection.sendall(rubbish)
            assert not re.match(rb"HTTP/1.\d 20", connection.recv(4096))
    server.publish(frame(1))
    with watching(server) as next_part:
        assert next_part().body


def asked(server, method="GET", path="/", **headers):
    """Return the status of a request with these headers."""
    connection = http.client.HTTPConnection("127.0.0.1", server.port, timeout=10)
    with contextlib.closing(connection):
        connection.putrequest(method, path, skip_host=True)
        for name, value in headers.items():
            connection.putheader(name, value)
        connection.endheaders()
        return connection.getresponse().status


@pytest.mark.parametrize(
    "host", ["127.0.0.1", "127.0.0.1:9", "localhost:8080", "LOCALHOST", "[::1]:80", "[::1]", None]
)
def test_who_asks_for_this_machine_sees_it(server, host):
    server.publish(frame(1))
    assert asked(server, **({} if host is None else {"Host": host})) == 200


@pytest.mark.parametrize(
    "host",
    ["evil.example", "evil.example:80", "127.0.0.1.evil.example", "localhost.evil.example:8", "", "10.0.0.1"],
)
@pytest.mark.parametrize(("method", "path"), [("GET", "/"), ("GET", "/stream.mjpg"), ("POST", "/go")])
def test_a_page_whose_name_leads_to_this_machine_sees_nothing(server, host, method, path):
    went = []
    server.on_go(lambda: went.append(1))
    server.publish(frame(1))
    assert asked(server, method, path, Host=host) == 403
    assert not went


@pytest.mark.parametrize(
    ("origin", "status"),
    [
        ("https://evil.example", 403),
        ("null", 403),
        ("", 403),
        ("http://127.0.0.1:8080", 204),
        ("http://localhost", 204),
    ],
)
def test_a_page_from_elsewhere_lets_nobody_walk(server, origin, status):
    went = []
    server.on_go(lambda: went.append(1))
    assert asked(server, "POST", "/go", Host="127.0.0.1", Origin=origin) == status
    assert bool(went) is (status == 204)
