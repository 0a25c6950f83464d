"""The drone's adapter says what is wrong when there is no drone to connect to."""

import contextlib
import dataclasses
import random
import socket
import threading
from collections.abc import Callable
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import common as mavlink

from adatracker_deploy.core.clock import MonotonicClock
from adatracker_deploy.core.errors import PlatformError, UsageError
from adatracker_deploy.core.ports import unused_port
from adatracker_deploy.registry import load_profile
from adatracker_drone.platform import DronePlatform

pytestmark = pytest.mark.slow


@pytest.fixture
def free_port():
    return unused_port(socket.SOCK_DGRAM)


def drone(url: str, connect_timeout_s: float = 1.0) -> DronePlatform:
    profile = load_profile("px4_quad", DronePlatform)
    connection = dataclasses.replace(profile.connection, url=url, connect_timeout_s=connect_timeout_s)
    return DronePlatform(dataclasses.replace(profile, connection=connection), MonotonicClock())


def test_a_port_that_another_program_holds_is_named_before_anything_starts():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind(("127.0.0.1", 0))
        port = other.getsockname()[1]
        platform = drone(f"udpin://127.0.0.1:{port}")
        with pytest.raises(UsageError, match=f"{port}.*connection.url"):
            platform.connect()
        platform.close()


def test_a_url_that_mavsdk_would_misread_is_refused():
    with pytest.raises(UsageError, match="localhost"):
        drone("udpin://localhost:14540").connect()


def test_silence_is_reported_with_the_address_and_what_to_do(free_port):
    platform = drone(f"udpin://127.0.0.1:{free_port}")
    with pytest.raises(PlatformError, match=f"no autopilot.*udpin://127.0.0.1:{free_port}.*power it"):
        platform.connect()
    with pytest.raises(PlatformError, match="connect first"):
        platform.preflight()


def test_another_vehicle_on_the_same_link_is_left_alone(free_port):
    platform = drone(f"udpin://127.0.0.1:{free_port}")
    stranger = mavlink.MAVLink(None, srcSystem=7, srcComponent=1)
    heartbeat = stranger.heartbeat_encode(mavlink.MAV_TYPE_QUADROTOR, mavlink.MAV_AUTOPILOT_PX4, 0, 0, 4)
    talking = _talking_to(free_port, lambda _: heartbeat.pack(stranger))
    with talking, pytest.raises(PlatformError, match="system id 1"):
        platform.connect()


@pytest.mark.parametrize(
    ("autopilot", "told"),
    [
        (
            mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA,
            "the autopilot is ArduPilot .* no stop and no check would",
        ),
        (mavlink.MAV_AUTOPILOT_GENERIC, "is not PX4 .*: it is left alone"),
    ],
)
def test_an_autopilot_that_is_no_px4_is_refused_with_the_reason_and_asked_for_nothing(
    free_port, autopilot, told
):
    platform = drone(f"udpin://127.0.0.1:{free_port}")
    sender = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    heartbeat = sender.heartbeat_encode(mavlink.MAV_TYPE_QUADROTOR, autopilot, 0, 0, 4).pack(sender)
    parser, heard, over = mavlink.MAVLink(None), [], threading.Event()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as vehicle:
        vehicle.settimeout(0.01)

        def beat():
            while not over.is_set():
                vehicle.sendto(heartbeat, ("127.0.0.1", free_port))
                with contextlib.suppress(OSError):
                    heard.extend(parser.parse_buffer(vehicle.recv(2048)) or [])

        beating = threading.Thread(target=beat)
        beating.start()
        try:
            with pytest.raises(PlatformError, match=told):
                platform.connect()
        finally:
            over.set()
            beating.join()
    asked = {message.command for message in heard if message.get_type() == "COMMAND_LONG"}
    print(f"MAVSDK itself: {sorted({message.get_type() for message in heard})}, commands {sorted(asked)}")
    assert not asked & {21, 22, 176, 400}  # land, take off, mode, arm
    assert not [message for message in heard if message.get_type().startswith(("PARAM_SET", "SET_POS"))]


def test_a_serial_port_that_is_not_there_is_named():
    with pytest.raises(UsageError, match=r"serial:///dev/ttyNONE:921600' cannot be opened"):
        drone("serial:///dev/ttyNONE:921600").connect()


def test_bytes_that_are_no_mavlink_are_no_drone_and_no_harm(free_port):
    platform = drone(f"udpin://127.0.0.1:{free_port}")
    chaos = random.Random(1)
    markers = (b"", b"\xfd", b"\xfe\x09\x00\x01\x01\x00")  # MAVLink 2, MAVLink 1 HEARTBEAT
    with _talking_to(free_port, lambda n: markers[n % 3] + chaos.randbytes(n % 300)) as sent:
        with pytest.raises(PlatformError, match="no autopilot"):
            platform.connect()
        assert sent[0] > 1000


def test_closing_from_another_thread_ends_the_wait_for_an_autopilot(free_port):
    platform = drone(f"udpin://127.0.0.1:{free_port}", connect_timeout_s=60.0)
    errors = []

    def connect() -> None:
        try:
            platform.connect()
        except PlatformError as error:
            errors.append(error)

    connecting = threading.Thread(target=connect)
    connecting.start()
    while not _is_bound(free_port):
        assert connecting.is_alive()
    platform.close()
    connecting.join(5.0)
    assert not connecting.is_alive()
    assert len(errors) == 1


def test_the_port_is_free_again_after_close(free_port):
    platform = drone(f"udpin://127.0.0.1:{free_port}")
    with pytest.raises(PlatformError):
        platform.connect()
    platform.close()
    assert not _is_bound(free_port)


def test_nothing_is_printed_while_nobody_answers(free_port, capfd):
    with pytest.raises(PlatformError):
        drone(f"udpin://127.0.0.1:{free_port}").connect()
    assert capfd.readouterr() == ("", "")


@contextlib.contextmanager
def _talking_to(port: int, packet: Callable[[int], bytes]):
    """Send packets as fast as the machine allows; give the count so far."""
    sent, stop = [0], threading.Event()

    def talk() -> None:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out:
            while not stop.is_set():
                out.sendto(packet(sent[0]), ("127.0.0.1", port))
                sent[0] += 1

    talking = threading.Thread(target=talk)
    talking.start()
    try:
        yield sent
    finally:
        stop.set()
        talking.join()


def _is_bound(port: int) -> bool:
    """Look without touching: a bind of ours would be in MAVSDK's way."""
    table = Path("/proc/net/udp").read_text(encoding="ascii")
    return any(line.split()[1].endswith(f":{port:04X}") for line in table.splitlines()[1:])
