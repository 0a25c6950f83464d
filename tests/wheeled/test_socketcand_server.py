"""The simulator's socketcand: python-can's own client talks to it; rubbish and floods do no harm."""

import contextlib
import socket
import time
import tracemalloc

import can
import pytest
from hypothesis import given
from hypothesis import strategies as st
from wheeled_rig import until

from adatracker_wheeled.protocol.frames import CanFrame
from adatracker_wheeled.sim.socketcand import LONGEST_LINE, MOST_CLIENTS, Parser, SocketcandServer, frame_line

frames = st.one_of(
    st.builds(CanFrame, st.integers(0, 0x7FF), st.binary(max_size=8)),
    st.builds(CanFrame, st.integers(0, 0x1FFFFFFF), st.binary(max_size=8), st.just(True)),
)


@pytest.fixture
def heard():
    return []


@pytest.fixture
def server(heard):
    with contextlib.closing(SocketcandServer(0, heard.append)) as server:
        yield server


@contextlib.contextmanager
def client(server):
    """python-can's client; tried again, as it trips over a frame right behind its last answer."""
    for _ in range(5):
        with contextlib.suppress(can.CanError):
            bus = can.Bus(interface="socketcand", channel="can0", host="127.0.0.1", port=server.port)
            break
    try:
        yield bus
    finally:
        bus.shutdown()


def message(frame):
    return can.Message(arbitration_id=frame.id, data=frame.data, is_extended_id=frame.extended)


def send_line(frame):
    digits = f"{frame.id:08X}" if frame.extended else f"{frame.id:03X}"
    return f"< send {digits} {len(frame.data):X} {' '.join(f'{byte:x}' for byte in frame.data)} >".encode()


# The parser


@given(st.lists(frames, max_size=20), st.integers(1, 50))
def test_frames_are_read_however_the_bytes_are_cut(sent, size):
    data = b"".join(map(send_line, sent))
    parser = Parser()
    pieces = [data[start : start + size] for start in range(0, len(data), size)]
    assert [request for piece in pieces for request in parser.feed(piece)] == sent
    assert parser.dropped == 0


def test_the_clients_words_are_understood():
    assert Parser().feed(b"< open can0 >< rawmode >< echo >") == ["open", "rawmode", "echo"]
    assert Parser().feed(b"< rehearsal >") == ["rehearsal"]


@pytest.mark.parametrize(
    "line",
    [
        b"< send 111 2 1 >",  # fewer bytes than it says
        b"< send 111 1 1 2 >",  # more
        b"< send 111 9 1 2 3 4 5 6 7 8 9 >",
        b"< send 800 0 >",  # 12 bits
        b"< send FFFFFFFF 0 >",  # 32 bits
        b"< send -11 0 >",
        b"< send 1_1 0 >",
        b"< send 111 1 100 >",
        b"< send 111 1 +1 >",
        b"< send 111 >",
        b"< send >",
        b"<send 111 0 >",
        b"< >",
        b">",
        b"< fly >",
        b"\xff\xfe >",
        b"< send 111 0" + b" " * LONGEST_LINE + b">",
    ],
)
def test_rubbish_is_dropped_and_counted_and_what_follows_is_read(line):
    parser = Parser()
    assert parser.feed(line + b"< send 123 1 FF >") == [CanFrame(0x123, b"\xff")]
    assert parser.dropped == 1


@given(st.binary(max_size=400))
def test_no_bytes_at_all_make_it_fail(data):
    for request in Parser().feed(data):
        assert request in ("open", "rawmode", "echo", "rehearsal") or isinstance(request, CanFrame)


def test_a_line_that_never_ends_takes_no_memory():
    parser = Parser()
    parser.feed(b"<")
    tracemalloc.start()
    for _ in range(10_000):
        assert parser.feed(b"x" * 100) == []
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 100_000


# The server


def test_python_can_sends_to_the_base_and_hears_it(server, heard):
    with client(server) as bus:
        for frame in (CanFrame(0x111, bytes(range(8))), CanFrame(0x1ADAFA17, b"\x01", extended=True)):
            bus.send(message(frame))
            until(lambda frame=frame: frame in heard)
            server.send(frame)
            got = bus.recv(2.0)
            assert (got.arbitration_id, bytes(got.data), got.is_extended_id) == (
                frame.id,
                frame.data,
                frame.extended,
            )


def test_clients_hear_each_other_but_not_themselves(server):
    with client(server) as one, client(server) as other:
        one.send(message(CanFrame(0x123, b"\x07")))
        assert other.recv(2.0).arbitration_id == 0x123
        assert one.recv(0.05) is None


def test_a_client_that_does_not_read_is_dropped_and_holds_nobody_up(server, heard):
    with contextlib.closing(socket.create_connection(("127.0.0.1", server.port))) as deaf:
        deaf.sendall(b"< open can0 >< rawmode >")
        with client(server) as bus:
            frame = CanFrame(0x221, bytes(8))
            bus.send(message(frame))
            until(lambda: heard)
            slowest_s = 0.0
            for _ in range(100_000):
                begun_s = time.monotonic()
                server.send(frame)
                slowest_s = max(slowest_s, time.monotonic() - begun_s)
                while bus.recv(0) is not None:
                    pass
                if len(server._clients) == 1:
                    break
            assert len(server._clients) == 1
            bus.send(message(CanFrame(0x222, b"")))
            until(lambda: CanFrame(0x222, b"") in heard)


def test_it_takes_only_so_many_clients(server):
    with contextlib.ExitStack() as stack:
        many = [
            stack.enter_context(socket.create_connection(("127.0.0.1", server.port)))
            for _ in range(MOST_CLIENTS + 1)
        ]
        for one in many:
            one.settimeout(2.0)
        assert [one.recv(16) for one in many] == [b"< hi >"] * MOST_CLIENTS + [b""]


def test_a_client_that_leaves_makes_room(server):
    for _ in range(3 * MOST_CLIENTS):
        with contextlib.closing(socket.create_connection(("127.0.0.1", server.port))) as one:
            one.settimeout(2.0)
            assert one.recv(16) == b"< hi >"
        until(lambda: not server._clients)


def test_a_flood_of_rubbish_does_not_reach_the_base(server, heard):
    with contextlib.closing(socket.create_connection(("127.0.0.1", server.port))) as hostile:
        hostile.sendall(b"< send 111 8 1 2 3 > <<< >>> \xff" * 20_000)
        hostile.sendall(b">< send 123 0 >")
        until(lambda: CanFrame(0x123, b"") in heard)
    assert heard == [CanFrame(0x123, b"")]


def test_a_busy_port_is_refused(server):
    with pytest.raises(OSError, match="in use"):
        SocketcandServer(server.port, print)


def test_a_closed_server_hangs_up_and_can_be_closed_again(heard):
    server = SocketcandServer(0, heard.append)
    with contextlib.closing(socket.create_connection(("127.0.0.1", server.port))) as one:
        one.settimeout(2.0)
        assert one.recv(16) == b"< hi >"
        server.close()
        server.close()
        assert one.recv(16) == b""


@given(frames)
def test_python_can_reads_the_line_that_tells_of_a_frame(frame):
    from can.interfaces.socketcand.socketcand import convert_ascii_message_to_can_message

    got = convert_ascii_message_to_can_message(frame_line(frame, 1.5).decode())
    assert (got.arbitration_id, bytes(got.data), got.is_extended_id, got.timestamp) == (
        frame.id,
        frame.data,
        frame.extended,
        1.5,
    )


def test_a_cable_that_is_cut_hangs_up_lets_nobody_in_and_can_be_mended(server):
    with contextlib.closing(socket.create_connection(("127.0.0.1", server.port))) as one:
        one.settimeout(2.0)
        assert one.recv(16) == b"< hi >"
        server.cut(True)
        assert one.recv(16) == b""
        with contextlib.closing(socket.create_connection(("127.0.0.1", server.port))) as late:
            late.settimeout(2.0)
            assert late.recv(16) == b""
    server.cut(False)
    with client(server) as bus:
        server.send(CanFrame(0x221, bytes(8)))
        assert bus.recv(2.0).arbitration_id == 0x221
