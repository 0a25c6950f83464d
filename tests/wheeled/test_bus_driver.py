"""Every python-can interface: what it is given, and the sentence where it cannot be opened.

Those that can be driven here are: slcan on a pty, a socketcand, a virtual bus.
"""

import contextlib
import dataclasses
import errno
import functools
import importlib
import inspect
import os
import pty
import socket
import threading
import time
import tty

import can
import pytest
from wheeled_rig import base_profile, until

from adatracker_deploy.core.errors import PlatformError, UsageError
from adatracker_deploy.core.ports import unused_port
from adatracker_wheeled.protocol.bus import Bus
from adatracker_wheeled.protocol.bus_driver import open_driver
from adatracker_wheeled.protocol.frames import CanFrame
from adatracker_wheeled.sim.socketcand import SocketcandServer

FRAME = CanFrame(0x111, bytes(8))


def connection(**changes):
    return dataclasses.replace(base_profile().connection, **changes)


def ignore(_frame):
    pass


@pytest.fixture
def heard():
    return []


# What is refused


@pytest.mark.parametrize("options", [{}, {"hop_limit": 1}, {"hop_limit": 64}])
def test_udp_multicast_is_refused_with_the_reason_unless_it_stays_on_this_machine(options):
    with pytest.raises(UsageError, match="udp_multicast sends motion commands to the whole network"):
        connection(interface="udp_multicast", options=options)


@pytest.mark.parametrize(
    "name", ["bitrate", "channel", "fd", "host", "ignore_config", "receive_own_messages"]
)
def test_what_stands_elsewhere_or_must_be_as_it_is_is_no_option(name):
    with pytest.raises(UsageError, match=f"options: {name} cannot be set there"):
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


@pytest.mark.parametrize(
    ("asked", "given"),
    [
        ({"interface": "pcan", "channel": "PCAN_USBBUS2"}, {"channel": "PCAN_USBBUS2", "bitrate": 500_000}),
        (
            {"interface": "kvaser", "channel": 1, "options": {"single_handle": True}},
            {"channel": 1, "bitrate": 500_000, "single_handle": True},
        ),
        (
            {"interface": "vector", "channel": 0, "options": {"app_name": "CANoe", "serial": 12345}},
            {"channel": 0, "bitrate": 500_000, "app_name": "CANoe", "serial": 12345},
        ),
        (
            {"interface": "udp_multicast", "channel": "239.74.163.2", "options": {"hop_limit": 0}},
            {"channel": "239.74.163.2", "hop_limit": 0},
        ),
        (
            {"interface": "socketcan", "channel": "can1", "options": {"local_loopback": False}},
            {"channel": "can1", "local_loopback": False},
        ),
        (
            {"interface": "virtual", "channel": "test", "options": {"rx_queue_size": 7}},
            {"channel": "test", "rx_queue_size": 7},
        ),
        (
            {"interface": "slcan", "channel": "/dev/ttyACM0", "options": {"tty_baudrate": 1_000_000}},
            {"channel": "/dev/ttyACM0", "bitrate": 500_000, "tty_baudrate": 1_000_000},
        ),
        (
            {"interface": "serial", "channel": "/dev/ttyUSB0", "options": {"baudrate": 1_000_000}},
            {"channel": "/dev/ttyUSB0", "bitrate": 500_000, "baudrate": 1_000_000},
        ),
    ],
    ids=lambda case: case.get("interface", ""),
)
def test_python_cans_own_constructor_is_called_with_what_it_can_take(monkeypatch, asked, given):
    module, name = can.interfaces.BACKENDS[asked["interface"]]
    driver = getattr(importlib.import_module(module), name)
    constructor, calls = inspect.signature(driver.__init__), []

    @functools.wraps(driver.__init__)
    def built(self, *arguments, **options):  # nothing is opened, and nothing sent
        self._is_shutdown = True
        calls.append(constructor.bind(self, *arguments, **options).arguments)

    monkeypatch.setattr(driver, "__init__", built)
    open_driver(connection(**asked))
    (call,) = calls
    taken = {**call, **call.get("kwargs", {})}
    assert {option: taken.get(option) for option in given} == given


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
    return unused_port(socket.SOCK_STREAM)


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


# Drivers that are not there


WITHOUT_A_LIBRARY = {"serial", "slcan", "robotell", "seeedstudio", "socketcan", "socketcand", "virtual"}
"""Those that need none here, and `udp_multicast`, which would join a group when it is opened."""


@pytest.mark.parametrize("interface", sorted(can.VALID_INTERFACES - WITHOUT_A_LIBRARY - {"udp_multicast"}))
def test_a_driver_whose_library_is_missing_is_said_in_a_sentence(interface):
    channel = "PCAN_USBBUS1" if interface == "pcan" else "0"
    with pytest.raises(UsageError) as refused:
        open_driver(connection(interface=interface, channel=channel))
    print(refused.value)
    assert f"connection: interface {interface} " in str(refused.value)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize("interface", ["serial", "slcan", "robotell", "seeedstudio"])
def test_a_serial_line_that_is_not_there_is_said_in_a_sentence(interface):
    with pytest.raises(
        PlatformError, match=rf"CAN bus /dev/ttyNONE \({interface}\) cannot be opened"
    ) as refused:
        open_driver(connection(interface=interface, channel="/dev/ttyNONE"))
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


@pytest.mark.parametrize(
    ("interface", "error"),
    [
        ("gs_usb", OSError(errno.EBUSY, "Resource busy")),
        ("slcan", can.CanInitializationError("could not open port: [Errno 16] Device or resource busy")),
        ("pcan", can.CanInitializationError("A PCAN Channel has not been initialized yet or is in use")),
    ],
)
def test_a_bus_that_another_program_has_is_a_usage_error_with_what_to_do(monkeypatch, interface, error):
    def held(*_, **__):
        raise error

    monkeypatch.setattr(can, "Bus", held)
    with pytest.raises(UsageError, match=r"cannot be opened: .*; end the program that has it") as refused:
        open_driver(connection(interface=interface, channel=0 if interface == "gs_usb" else "X"))
    assert "\n" not in str(refused.value)


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


# A bus over TCP


@pytest.mark.parametrize("options", [{}, {"tcp_tune": False}], ids=["as usual", "untuned"])
def test_a_socketcand_is_driven_in_raw_mode_and_has_its_own_options(heard, options):
    told = []
    server = SocketcandServer(0, told.append)
    on = connection(interface="socketcand", channel="can0", port=server.port, options=options)
    with contextlib.closing(server), contextlib.closing(Bus.open(on, heard.append)) as bus:
        assert bus.send(FRAME)
        assert bus.send(CanFrame(0x1ADAFA17, b"\x01\x02\x03", extended=True))
        until(lambda: len(told) == 2)
        server.send(CanFrame(0x211, bytes(range(1, 9))))
        until(lambda: any(heard))
    assert told == [FRAME, CanFrame(0x1ADAFA17, b"\x01\x02\x03", extended=True)]
    assert next(filter(None, heard)) == CanFrame(0x211, bytes(range(1, 9)))


def test_an_option_that_socketcand_has_not_is_refused():
    server = SocketcandServer(0, ignore)
    on = connection(interface="socketcand", channel="can0", port=server.port, options={"tcp_tuned": True})
    with (
        contextlib.closing(server),
        pytest.raises(UsageError, match=r"socketcand has no 'tcp_tuned'; it has .*tcp_tune"),
    ):
        open_driver(on)


def test_two_programs_share_a_virtual_bus(heard):
    on = connection(interface="virtual", channel="shared")
    with contextlib.closing(Bus.open(on, heard.append)), contextlib.closing(Bus.open(on, ignore)) as other:
        assert other.send(FRAME)
        until(lambda: FRAME in heard)
