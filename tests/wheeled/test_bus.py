"""The bus: frames both ways, and how each way to lose it is noticed."""

import contextlib
import dataclasses
import errno
import queue
import socket
import struct
import threading
import time

import can
import pytest
from wheeled_rig import base_profile, until

from adatracker_deploy.core.errors import PlatformError
from adatracker_wheeled.protocol.bus import STUCK_S, Bus
from adatracker_wheeled.protocol.frames import CanFrame
from adatracker_wheeled.sim.socketcand import SocketcandServer

FRAME = CanFrame(0x111, bytes(8))


def connection(**changes):
    return dataclasses.replace(base_profile().connection, **changes)


def ignore(_frame):
    pass


# A driver that fails as the facts say that drivers fail


class Driver:
    """A python-can bus whose device can be made to fail."""

    def __init__(self):
        self.arrivals = queue.Queue()
        self.sent = []
        self.error = None
        self.closed = 0

    def send(self, message):
        if self.error is not None:
            raise self.error
        self.sent.append(message)

    def recv(self, timeout):
        try:
            arrived = self.arrivals.get(timeout=timeout)
        except queue.Empty:
            return None
        if isinstance(arrived, Exception):
            raise arrived
        return arrived

    def shutdown(self):
        self.closed += 1
        if self.error is not None:
            raise self.error


@pytest.fixture
def driver():
    return Driver()


@pytest.fixture
def heard():
    return []


@pytest.fixture
def bus(driver, heard):
    with contextlib.closing(Bus(driver, "can0 (test)", heard.append)) as bus:
        yield bus


def test_frames_pass_both_ways(bus, driver, heard):
    assert bus.send(CanFrame(0x1ADAFA17, b"\x01\x02", extended=True))
    (message,) = driver.sent
    assert (message.arbitration_id, bytes(message.data), message.is_extended_id) == (
        0x1ADAFA17,
        b"\x01\x02",
        True,
    )
    driver.arrivals.put(can.Message(arbitration_id=0x221, data=b"\x03", is_extended_id=False))
    until(lambda: CanFrame(0x221, b"\x03") in heard)


@pytest.mark.parametrize(
    "message",
    [
        can.Message(arbitration_id=0x111, is_remote_frame=True, dlc=8, is_extended_id=False),
        can.Message(arbitration_id=0x111, is_fd=True, data=bytes(64), is_extended_id=False),
        can.Message(arbitration_id=0x4, is_error_frame=True, data=bytes(8)),
        can.Message(arbitration_id=0x111, data=bytes(9), dlc=9, is_extended_id=False),
        can.Message(arbitration_id=0x7FFFFFFF, data=b"", is_extended_id=False),
    ],
    ids=["remote", "FD", "error", "oversized", "id too wide"],
)
def test_what_is_no_classic_data_frame_is_counted_and_passed_by(bus, driver, heard, message):
    driver.arrivals.put(message)
    until(lambda: bus.strange == 1)
    assert not any(heard)
    assert not bus.lost


def assert_lost(bus, heard, reason, within_s=0.2):
    took_s = until(lambda: bus.lost)
    assert reason in bus.lost
    assert took_s < within_s
    until(lambda: heard and heard[-1] is None)  # whoever watches is told at once
    with pytest.raises(PlatformError, match=r"CAN bus can0 \(test\) is lost"):
        bus.send(FRAME)


@pytest.mark.parametrize(
    ("number", "reason"), [(100, "Network is down"), (6, "No such device"), (19, "No such device")]
)
def test_a_device_that_goes_down_or_away_loses_the_bus(bus, driver, heard, number, reason):
    driver.arrivals.put(can.CanOperationError(f"Error receiving: {reason}", number))
    assert_lost(bus, heard, reason)


def test_bus_off_loses_the_bus(bus, driver, heard):
    driver.arrivals.put(can.Message(arbitration_id=0x40, is_error_frame=True, data=bytes(8)))
    assert_lost(bus, heard, "bus-off")


def test_whatever_a_driver_raises_loses_the_bus_and_never_passes_for_silence(bus, driver, heard):
    driver.arrivals.put(IndexError("a driver's own bug"))
    assert_lost(bus, heard, "a driver's own bug")


@pytest.mark.parametrize(
    "error",
    [BrokenPipeError(errno.EPIPE, "Broken pipe"), TypeError("a driver's own bug")],
    ids=["as foreseen", "unforeseen"],
)
def test_a_send_that_fails_loses_the_bus(bus, driver, heard, error):
    driver.error = error
    with pytest.raises(PlatformError, match="is lost"):
        bus.send(FRAME)
    driver.error = None
    assert_lost(bus, heard, error.args[-1])
    assert driver.sent == []


@pytest.mark.parametrize(
    "full",
    [
        can.CanOperationError("Failed to transmit: No buffer space available", errno.ENOBUFS),
        can.CanOperationError("Transmit buffer full"),
    ],
    ids=["ENOBUFS", "not writable"],
)
def test_a_full_queue_drops_frames_and_keeps_none_for_later(bus, driver, full):
    driver.error = full
    assert not bus.send(FRAME)
    assert not bus.send(FRAME)
    assert bus.dropped == 2
    driver.error = None
    assert bus.send(FRAME)
    assert len(driver.sent) == 1
    assert not bus.lost


def test_a_bus_that_stays_full_is_lost(bus, driver, heard):
    driver.error = can.CanOperationError("Transmit buffer full")
    begun_s = time.monotonic()

    def stuck():
        with contextlib.suppress(PlatformError):
            bus.send(FRAME)
        return bus.lost

    until(stuck)
    assert STUCK_S <= time.monotonic() - begun_s < STUCK_S + 0.1
    assert_lost(bus, heard, "has taken no frame")


def test_a_closed_bus_can_be_closed_again_and_tells_nobody(driver, heard):
    bus = Bus(driver, "can0 (test)", heard.append)
    bus.close()
    count = len(heard)
    bus.close()
    assert len(heard) == count


def test_a_device_that_fails_when_it_is_released_harms_nobody(driver):
    bus = Bus(driver, "can0 (test)", ignore)
    driver.error = can.CanOperationError("No such device", 19)
    bus.close()
    assert driver.closed == 1


def test_an_echo_of_our_own_frame_is_not_heard(bus, driver, heard):
    driver.arrivals.put(can.Message(arbitration_id=0x111, data=bytes(8), is_extended_id=False, is_rx=False))
    driver.arrivals.put(can.Message(arbitration_id=0x221, data=bytes(8), is_extended_id=False))
    until(lambda: any(frame is not None for frame in heard))
    assert [frame.id for frame in heard if frame is not None] == [0x221]


def test_what_another_program_of_this_machine_has_sent_is_heard_where_nothing_is_echoed(driver, heard):
    """SocketCAN: a simulator, a gateway, or a second operator's program on the same computer."""
    tapped = []
    with contextlib.closing(Bus(driver, "can0 (test)", heard.append, tapped.append, shared=True)):
        driver.arrivals.put(can.Message(arbitration_id=0x111, is_extended_id=False, is_rx=False))
        until(lambda: any(frame is not None for frame in heard))
    assert [frame.id for frame in heard if frame is not None] == [0x111]
    assert [message.is_rx for message in tapped] == [True]


# A simulator that goes


def test_a_socketcand_that_closes_loses_the_bus_at_once_without_spinning():
    server = SocketcandServer(0, ignore)
    heard = []
    on = connection(interface="socketcand", channel="can0", port=server.port)
    with contextlib.closing(Bus.open(on, heard.append)) as bus:
        assert bus.send(FRAME)
        server.close()
        took_s = until(lambda: bus.lost)
        print(f"a socketcand that closes is noticed after {took_s * 1e3:.0f} ms")
        assert took_s < 0.2
        assert "has closed the connection" in bus.lost
        before_s = time.process_time()
        threading.Event().wait(0.3)
        assert time.process_time() - before_s < 0.05


def test_a_socketcand_that_resets_the_connection_is_said_in_a_sentence():
    """As one does that is killed with commands unread; python-can's error then holds a whole traceback."""
    server = SocketcandServer(0, ignore)
    on = connection(interface="socketcand", channel="can0", port=server.port)
    with contextlib.closing(Bus.open(on, ignore)) as bus:
        assert bus.send(FRAME)
        for client in server._clients:
            client.socket.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        server.close()
        until(lambda: bus.lost)
        assert "reset by peer" in bus.lost
        assert "Traceback" not in bus.lost
        assert "\n" not in bus.lost


def test_a_busy_socketcand_opens_all_the_same():
    server = SocketcandServer(0, ignore)
    over = threading.Event()

    def chatter():
        while not over.wait(0.0005):
            server.send(FRAME)

    thread = threading.Thread(target=chatter)
    thread.start()
    try:
        on = connection(interface="socketcand", channel="can0", port=server.port)
        for _ in range(20):
            Bus.open(on, ignore).close()
    finally:
        over.set()
        thread.join()
        server.close()
