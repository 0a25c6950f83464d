"""The live view serves this machine and Foxglove only, and bounds the number and requests of clients."""

from __future__ import annotations

import contextlib
import json
import socket
import struct
import threading
import time

import pytest

from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.trial.channels import Message
from adatracker_deploy.trial.live_access import why_refused
from adatracker_deploy.trial.live_backlog import BACKLOG, BACKLOG_BYTES, Backlog
from adatracker_deploy.trial.live_port import choose_port
from adatracker_deploy.trial.live_view import MAX_CLIENTS, STOP_TIMEOUT_S, LiveView

pytest.importorskip("websockets", reason="needs the extra 'live'")

from websockets.exceptions import ConnectionClosed, InvalidHandshake, InvalidStatus
from websockets.frames import Frame, Opcode
from websockets.sync.client import connect

from adatracker_deploy.trial import live_client
from tests.trial.test_log import eventually
from tests.trial.viewer import SUBPROTOCOL, WAIT_S, Viewer

SERVED = ["127.0.0.1", "127.0.0.1:9", "localhost:8080", "LOCALHOST", "[::1]:80", "[::1]"]
FOREIGN_HOSTS = [
    "evil.example",
    "evil.example:80",
    "127.0.0.1.evil.example",
    "localhost.evil.example:8",
    "",
    "10.0.0.1",
    "localhost:80:80",
    "127.0.0.1\n",
    "127.0.0.1:٨",
]
WELCOME = [
    "https://app.foxglove.dev",
    "https://studio.foxglove.dev",
    "http://localhost",
    "http://localhost:8080",
    "https://localhost:3000",
    "http://127.0.0.1:5000",
    "file://",
]
FOREIGN = [
    "https://evil.example",
    "http://app.foxglove.dev",
    "https://app.foxglove.dev.evil.example",
    "https://evil.example/https://app.foxglove.dev",
    "https://appXfoxglove.dev",
    "https://app.foxglove.dev:8443",
    "http://localhost.evil.example",
    "http://localhost@evil.example",
    "http://10.0.0.1",
    "null",
    "file://evil.example",
    "",
]


@pytest.fixture
def view():
    """Give a live view and its port."""
    port = choose_port(0)
    shown = LiveView(port)
    yield shown, port
    shown.close()


def connected(port, host=None, origin=None, subprotocols=(SUBPROTOCOL,)):
    """Open a websocket with these headers."""
    sock = socket.create_connection(("127.0.0.1", port), WAIT_S)
    return connect(
        f"ws://{host or f'127.0.0.1:{port}'}/",
        sock=sock,
        origin=origin,
        subprotocols=list(subprotocols) or None,
        close_timeout=0.1,
    )


def status_of(port, **headers):
    """Return the HTTP status of the answer to a request with these headers."""
    try:
        with connected(port, **headers) as websocket:
            assert json.loads(websocket.recv(timeout=WAIT_S))["op"] == "serverInfo"
    except InvalidStatus as refused:
        return refused.response.status_code
    return 101


def a_message(size=10, topic="/step"):
    return Message(topic, 1, bytes(size), 0)


def raw(port, request):
    """Send raw bytes; return the whole answer, until the connection ends."""
    with socket.create_connection(("127.0.0.1", port), WAIT_S) as asked:
        asked.sendall(request)
        answer = b""
        with contextlib.suppress(ConnectionResetError):
            while data := asked.recv(4096):
                answer += data
        return answer


@pytest.mark.parametrize("host", SERVED)
def test_a_name_of_this_machine_is_served(host):
    assert why_refused([host], []) is None


@pytest.mark.parametrize("hosts", [[], ["localhost", "localhost"], *([host] for host in FOREIGN_HOSTS)])
def test_a_foreign_name_for_this_machine_is_refused(hosts):
    assert "host" in why_refused(hosts, [])


@pytest.mark.parametrize("origin", WELCOME)
def test_the_application_and_pages_of_this_machine_are_welcome(origin):
    assert why_refused(["localhost"], [origin]) is None


@pytest.mark.parametrize("origins", [WELCOME[:2], *([origin] for origin in FOREIGN)])
def test_pages_from_elsewhere_are_refused(origins):
    assert "origin" in why_refused(["localhost"], origins)


@pytest.mark.parametrize(
    ("headers", "status"),
    [
        ({}, 101),
        ({"origin": "https://app.foxglove.dev"}, 101),
        ({"origin": "http://localhost:8080"}, 101),
        ({"host": "localhost:8765"}, 101),
        ({"origin": "https://evil.example"}, 403),
        ({"origin": "null"}, 403),
        ({"host": "evil.example"}, 403),
        ({"host": "evil.example", "origin": "http://evil.example"}, 403),
        ({"host": "evil.example", "origin": "https://app.foxglove.dev"}, 403),
        ({"subprotocols": ["foxglove.websocket.v1"]}, 101),
        ({"subprotocols": ["other.v1"]}, 400),
        ({"subprotocols": []}, 400),
    ],
)
def test_who_asks_is_seen_before_anything_is_told(view, headers, status):
    assert status_of(view[1], **headers) == status


HANDSHAKE = (
    b"GET / HTTP/1.1\r\nHost: localhost\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
    b"Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Version: 13\r\n"
    b"Sec-WebSocket-Protocol: foxglove.sdk.v%b\r\n\r\n"
)


@pytest.mark.parametrize(
    ("request_", "status"),
    [
        (b"GET / HTTP/1.1\r\nHost: localhost\r\n\r\n", b" 426 "),
        (b"GET / HTTP/1.1\r\n\r\n", b" 403 "),
        (b"GET / HTTP/1.1\r\nHost: localhost\r\nHost: evil.example\r\n\r\n", b" 403 "),
        (HANDSHAKE % b"\x8d", b""),
        (HANDSHAKE % b"1" + b"\xff" * 20, b""),  # bytes that are no valid frame, sent with the request
        (b"\x16\x03\x01 no HTTP at all\r\n\r\n", b""),
        (b"GET / HTTP/1.1\r\nX: " + b"x" * 100_000 + b"\r\n\r\n", b""),
    ],
)
def test_what_is_no_websocket_is_told_nothing(view, request_, status):
    shown, port = view
    answer = raw(port, request_)
    assert status in answer
    assert b"serverInfo" not in answer
    shown.show([])  # it has not failed
    assert connects(port)


def test_a_flood_of_connections_is_bounded_and_passes(view, monkeypatch):
    monkeypatch.setattr(live_client, "PATIENCE_S", 60.0)
    shown, port = view
    threads = threading.active_count()
    with contextlib.ExitStack() as held:
        watcher = held.enter_context(Viewer(port, topics={"/step"}))
        flood = [held.enter_context(socket.create_connection(("127.0.0.1", port))) for _ in range(100)]
        closed = 0
        for each in flood:
            each.settimeout(0.05)
            with contextlib.suppress(TimeoutError):
                with contextlib.suppress(ConnectionResetError):
                    assert each.recv(1) == b""
                closed += 1
        assert closed == 100 - (MAX_CLIENTS - 1)
        assert threading.active_count() <= threads + 1  # the watcher's own
        with pytest.raises((InvalidHandshake, ConnectionClosed, OSError, EOFError)):
            status_of(port)
        shown.show([a_message()])
        frame = watcher.websocket.recv(timeout=WAIT_S)
        assert frame[13:] == a_message().data  # it is served meanwhile
    eventually(lambda: connects(port))


def connects(port):
    try:
        return status_of(port) == 101
    except (InvalidHandshake, ConnectionClosed, OSError, EOFError):
        return False


def test_who_never_asks_is_let_go(monkeypatch):
    monkeypatch.setattr(live_client, "PATIENCE_S", 0.2)
    port = choose_port(0)
    shown = LiveView(port)
    with contextlib.closing(shown), socket.create_connection(("127.0.0.1", port), WAIT_S) as silent:
        assert silent.recv(1) == b""


TOO_MANY_BYTES = live_client.LARGEST_REQUEST_BYTES + 1
ANNOUNCED = Frame(Opcode.TEXT, bytes(TOO_MANY_BYTES)).serialize(mask=True)[:-TOO_MANY_BYTES]
PART = Frame(Opcode.CONT, bytes(1000), fin=False).serialize(mask=True)
IN_PARTS = (
    Frame(Opcode.TEXT, b"", fin=False).serialize(mask=True) + TOO_MANY_BYTES // 1000 * PART + PART[:-1000]
)


@pytest.mark.parametrize("request_", [ANNOUNCED, IN_PARTS], ids=["announced", "in parts"])
def test_a_request_that_is_too_large_ends_the_connection(view, request_):
    # Just enough bytes to end it: a client still sending when the socket closes never reads the reason.
    with Viewer(view[1], topics=()) as viewer:
        viewer.socket.sendall(request_)
        with pytest.raises(ConnectionClosed) as ended:
            viewer.ask()
        assert ended.value.rcvd.code == 1009
    assert connects(view[1])


@pytest.mark.parametrize(
    "request_",
    [
        "",
        "[]",
        "5",
        "{",
        "[" * 60_000,
        '{"op": 5}',
        '{"op": "subscribe"}',
        '{"op": "subscribe", "subscriptions": [5]}',
        '{"op": "subscribe", "subscriptions": [{"id": -1, "channelId": 1}]}',
        '{"op": "subscribe", "subscriptions": [{"id": true, "channelId": 1}]}',
        '{"op": "subscribe", "subscriptions": [{"id": 4294967296, "channelId": 1}]}',
        '{"op": "subscribe", "subscriptions": [{"id": 1, "channelId": 99}]}',
        '{"op": "unsubscribe", "subscriptionIds": [77]}',
        '{"op": "unsubscribe", "subscriptionIds": [[]]}',
        '{"op": "time"}',
        b"",
        b"\x01",
        b"\x02\x00",
        struct.pack("<BI", 1, 1) + b"{}",
    ],
)
def test_a_request_that_makes_no_sense_is_answered_and_forgotten(view, request_):
    with Viewer(view[1], topics=()) as viewer:
        viewer.websocket.send(request_)
        answer = viewer.ask()
        assert (answer["op"], answer["level"]) == ("status", 2)
        assert len(answer["message"]) < 120


def test_a_request_in_parts_is_understood(view):
    with Viewer(view[1], topics=()) as viewer:
        viewer.websocket.send(['{"op": "sub', 'scribe", "subscr', 'iptions": [{"id": 9, "channelId": 1}]}'])
        viewer.ask(op="getParameters")
        view[0].show([a_message(3)])
        assert viewer.websocket.recv(timeout=WAIT_S) == struct.pack("<BIQ", 1, 9, 1) + bytes(3)


def test_who_unsubscribes_is_told_no_more_of_it(view):
    shown, port = view
    with Viewer(port, topics={"/step", "/log"}) as viewer:
        numbers = {topic: number for number, (topic, _) in viewer._kinds.items()}
        viewer.send(op="unsubscribe", subscriptionIds=[numbers["/step"]])
        viewer.ask(op="getParameters")
        shown.show([a_message(), a_message(4, "/log")])
        frame = viewer.websocket.recv(timeout=WAIT_S)
        assert struct.unpack_from("<BIQ", frame)[1] == numbers["/log"]


def test_one_channel_is_subscribed_to_once(view):
    with Viewer(view[1], topics={"/step"}) as viewer:
        (number,) = viewer._kinds
        (channel,) = (each["id"] for each in viewer.channels if each["topic"] == "/step")
        for wanted in ({"id": number + 1, "channelId": channel}, {"id": number, "channelId": channel + 1}):
            assert "taken" in viewer.ask(op="subscribe", subscriptions=[wanted])["message"]


def test_who_asks_and_never_reads_the_answers_is_not_read_any_more(view):
    shown, port = view
    with Viewer(port, topics=(), receive_bytes=1 << 12) as asker, Viewer(port, topics={"/step"}) as watcher:
        asker.socket.settimeout(0.5)
        with contextlib.suppress(TimeoutError):  # the kernel's buffers are full; the view's must not be
            while True:
                asker.socket.sendall(b"\x81\x80\0\0\0\0" * 1000)  # empty texts
        (client,) = [each for each in shown._clients if not each.wants_to_read]
        assert sum(map(len, client._out)) < 1 << 20
        shown.show([a_message()])
        assert watcher.websocket.recv(timeout=WAIT_S)[13:] == a_message().data


def test_the_backlog_keeps_the_newest_of_bounded_number_and_size():
    backlog = Backlog()
    for number in range(BACKLOG + 5):
        backlog.put(Message("/step", number, b"", number))
    assert backlog.take().sequence == 5
    for _ in range(20):
        backlog.put(a_message(BACKLOG_BYTES // 10))
    kept = 0
    while backlog.take() is not None:
        kept += 1
    assert kept <= 10
    backlog.put(a_message(BACKLOG_BYTES + 1))  # alone
    backlog.put(a_message(1))
    assert len(backlog.take().data) == 1
    assert backlog.take() is None


def test_the_end_is_told_and_what_waits_is_told_before_it(view):
    shown, port = view
    with Viewer(port, topics={"/step"}) as viewer:
        shown.show([a_message(100_000) for _ in range(50)])
        begun_s = time.monotonic()
        closing = threading.Thread(target=shown.close)
        closing.start()
        for _ in range(50):
            viewer.websocket.recv(timeout=WAIT_S)
        with pytest.raises(ConnectionClosed) as ended:
            viewer.websocket.recv(timeout=WAIT_S)
        closing.join()
    assert ended.value.rcvd.code == 1001
    assert time.monotonic() - begun_s < STOP_TIMEOUT_S + 1


def test_a_view_that_failed_says_so(view, monkeypatch):
    shown, port = view

    def fail():
        raise OSError("no more files")

    monkeypatch.setattr(shown, "_accept", fail)
    with socket.create_connection(("127.0.0.1", port)):
        eventually(lambda: shown._failure)
    with pytest.raises(RuntimeError, match="no more files"):
        shown.show([])


def test_a_port_in_use_is_refused(view):
    with pytest.raises(UsageError, match=rf"TCP port {view[1]} for the live view: Address already in use;"):
        LiveView(view[1])
