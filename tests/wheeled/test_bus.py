"""The bus: what opens and what is refused in a sentence, and how each way to lose it is noticed."""

import contextlib
import dataclasses
import errno
import os
import pty
import queue
import socket
import threading
import time
import tty

import can
import pytest
from wheeled_rig import base_profile, until

from adatracker_deploy.core.errors import PlatformError, UsageError
from adatracker_wheeled.protocol.bus import STUCK_S, Bus
from adatracker_wheeled.protocol.bus_driver import open_driver
from adatracker_wheeled.protocol.frames import CanFrame
from adatracker_wheeled.sim.socketcand import SocketcandServer

FRAME = CanFrame(0x111, bytes(8))


def connection(**changes):
    return dataclasses.replace(base_profile().connection, **changes)


def ignore(_frame):
    pass


# What is refused


@pytest.mark.parametrize("options", [{}, {"hop_limit": 1}, {"hop_limit": 64}])
def test_udp_multicast_is_refused_with_the_reason_unless_it_stays_on_this_machine(options):
    with pytest.raises(UsageError, match="udp_multicast sends motion commands to the whole network"):
        connection(interface="udp_multicast", options=options)


@pytest.mark.parametrize(
    "name", ["bitrate", "channel", "fd", "host", "ignore_config", "receive_own_messages"]
)
def test_what_stands_elsewhere_or_must_be_as_it_is_is_no_option(name):
    with pytest.raises(UsageError, match=f"options: {name} is not to be set there"):
        connection(interface="slcan", options={name: 1})


def test_an_option_that_the_driver_would_ignore_is_refused_with_those_that_it_has():
    on = connection(interface="slcan", channel="/dev/null", options={"tty_baud": 1_000_000})
    with pytest.raises(UsageError, match=r"slcan has no 'tty_baud'; it has tty_baudrate, .*listen_only"):
        open_driver(on)


@pytest.mark.parametrize(
    ("asked", "given"),
    [
        (
            {"interface": "gs_usb", "channel": 0, "bitrate": 250_000},
            {"interface": "gs_usb", "channel": 0, "bitrate": 250_000},
        ),
        (
            {"interface": "slcan", "channel": "/dev/ttyACM0", "options": {"tty_baudrate": 1_000_000}},
            {"interface": "slcan", "channel": "/dev/ttyACM0", "bitrate": 500_000, "tty_baudrate": 1_000_000},
        ),
        (
            {"interface": "pcan", "channel": "PCAN_USBBUS1", "options": {"device_id": 7}},
            {"interface": "pcan", "channel": "PCAN_USBBUS1", "bitrate": 500_000, "device_id": 7},
        ),
        (
            {"interface": "kvaser", "channel": 1, "options": {"accept_virtual": False}},
            {"interface": "kvaser", "channel": 1, "bitrate": 500_000, "accept_virtual": False},
        ),
        (
            {"interface": "vector", "channel": 0, "options": {"app_name": "CANoe", "serial": 12345}},
            {"interface": "vector", "channel": 0, "bitrate": 500_000, "app_name": "CANoe", "serial": 12345},
        ),
        (
            {"interface": "ixxat", "channel": 0, "options": {"unique_hardware_id": 5}},
            {"interface": "ixxat", "channel": 0, "bitrate": 500_000, "unique_hardware_id": 5},
        ),
        (
            {"interface": "udp_multicast", "channel": "239.74.163.2", "options": {"hop_limit": 0}},
            {"interface": "udp_multicast", "channel": "239.74.163.2", "hop_limit": 0},
        ),
        ({"interface": "socketcan", "channel": "can1"}, {"interface": "socketcan", "channel": "can1"}),
    ],
    ids=lambda case: case["interface"] if "ignore_config" not in case else "",
)
def test_a_driver_is_given_what_the_profile_says_and_nothing_else(monkeypatch, asked, given):
    calls = []
    monkeypatch.setattr(can, "Bus", lambda **arguments: calls.append(arguments))
    open_driver(connection(**asked))
    assert calls == [given | {"ignore_config": True}]


def test_two_adapters_of_one_kind_are_two_robots_and_one_is_one_however_it_is_set_up():
    def robot(**changes):
        return connection(**changes).robot

    assert robot(interface="gs_usb", channel=0) != robot(interface="gs_usb", channel=1)
    one = {"interface": "vector", "channel": 0}
    assert robot(**one, options={"serial": 1}) != robot(**one, options={"serial": 2})
    assert robot(**one, options={"app_name": "A"}) == robot(**one, options={"app_name": "B"})
    line = {"interface": "slcan", "channel": "/dev/ttyACM0"}
    assert robot(**line) == robot(interface="slcan", channel="/dev/ttyACM0@115200")


def test_an_unknown_interface_is_refused_with_a_near_one():
    with pytest.raises(UsageError, match="no interface 'sockecan'; did you mean 'socketcan'"):
        Bus.open(connection(interface="sockecan"), ignore)


def test_a_driver_that_is_not_installed_is_named():
    with pytest.raises(UsageError, match="interface nican lacks its driver"):
        Bus.open(connection(interface="nican", channel="CAN0"), ignore)


def test_an_absent_device_is_said_with_what_to_do(capfd):
    with pytest.raises(
        PlatformError, match=r"CAN bus can77 \(socketcan\) cannot be opened: .*connection.channel"
    ):
        Bus.open(connection(interface="socketcan", channel="can77"), ignore)
    assert capfd.readouterr() == ("", "")


def free_port():
    with socket.create_server(("127.0.0.1", 0)) as probe:
        return probe.getsockname()[1]


def test_a_port_that_nobody_answers_is_said_within_2_s():
    begun_s = time.monotonic()
    with pytest.raises(PlatformError, match="no socketcand answers for can0 on 127"):
        Bus.open(connection(interface="socketcand", channel="can0", port=free_port()), ignore)
    assert time.monotonic() - begun_s < 2.0


@pytest.mark.parametrize("greeting", [b"", b"SSH-2.0-OpenSSH_9.2\r\n"], ids=["silent", "something else"])
def test_a_port_where_something_else_listens_is_said_within_2_s(greeting):
    begun_s = time.monotonic()
    with socket.create_server(("127.0.0.1", 0)) as server:

        def greet():
            peer, _ = server.accept()
            with peer:
                peer.sendall(greeting)
                peer.recv(100)

        threading.Thread(target=greet, daemon=True).start()
        port = server.getsockname()[1]
        with pytest.raises(PlatformError, match="no socketcand answers"):
            Bus.open(connection(interface="socketcand", channel="can0", port=port), ignore)
    assert time.monotonic() - begun_s < 2.0


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


# An adapter on a serial line


@pytest.fixture
def line():
    """A pty whose far side is an slcan adapter's: what it was sent, and how to send."""
    ours, theirs = pty.openpty()
    tty.setraw(theirs)
    yield ours, os.ttyname(theirs)
    os.close(ours)
    os.close(theirs)


def test_an_slcan_adapter_on_a_serial_line_is_set_up_and_driven(line, heard):
    ours, name = line
    on = connection(interface="slcan", channel=name, bitrate=250_000, options={"sleep_after_open": 0.0})
    sent = b""
    with contextlib.closing(Bus.open(on, heard.append)) as bus:
        assert bus.send(CanFrame(0x111, bytes(range(8))))
        os.write(ours, b"t21180102030405060708\r")
        until(lambda: any(heard))
        while b"t111" not in sent:
            sent += os.read(ours, 100)
    assert sent.split(b"\r")[:1] == [b"C"]
    assert b"S5\r" in sent  # 250 kbit/s
    assert b"t11180001020304050607\r" in sent
    assert next(filter(None, heard)) == CanFrame(0x211, bytes(range(1, 9)))


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


# Drivers that are not there


@pytest.mark.parametrize("interface", ["kvaser", "neovi", "ixxat", "vector", "pcan", "nican", "etas"])
def test_a_driver_whose_library_is_missing_is_said_in_a_sentence(interface):
    channel = "PCAN_USBBUS1" if interface == "pcan" else "0"
    with pytest.raises((UsageError, PlatformError)) as refused:
        open_driver(connection(interface=interface, channel=channel))
    print(refused.value)
    assert interface in str(refused.value)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    "error", [NameError("name 'canGetNumberOfChannels'"), AttributeError("x"), KeyError(1)]
)
def test_whatever_a_driver_raises_is_a_usage_error(monkeypatch, error):
    def broken(*_, **__):
        raise error

    monkeypatch.setattr(can, "Bus", broken)
    with pytest.raises(UsageError, match="interface kvaser cannot be used here"):
        open_driver(connection(interface="kvaser", channel="0"))


def test_an_echo_of_our_own_frame_is_not_heard(bus, driver, heard):
    driver.arrivals.put(can.Message(arbitration_id=0x111, data=bytes(8), is_extended_id=False, is_rx=False))
    driver.arrivals.put(can.Message(arbitration_id=0x221, data=bytes(8), is_extended_id=False))
    until(lambda: any(frame is not None for frame in heard))
    assert [frame.id for frame in heard if frame is not None] == [0x221]
