"""What the drone's adapter says when there is no drone."""

import dataclasses
import socket
import threading
from pathlib import Path

import pytest
from adatracker_drone.platform import DronePlatform

from adatracker_deploy.errors import PlatformError, UsageError
from adatracker_deploy.profile import load_profile
from adatracker_deploy.runtime.clock import MonotonicClock


@pytest.fixture
def free_port():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


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
    with pytest.raises(PlatformError, match=f"no autopilot heard on udpin://127.0.0.1:{free_port}.*power it"):
        platform.connect()
    with pytest.raises(PlatformError, match="connect first"):
        platform.preflight()


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


def _is_bound(port: int) -> bool:
    """Look without touching: a bind of ours would be in MAVSDK's way."""
    table = Path("/proc/net/udp").read_text(encoding="ascii")
    return any(line.split()[1].endswith(f":{port:04X}") for line in table.splitlines()[1:])
