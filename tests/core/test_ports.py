"""A port that somebody will bind a moment later stays theirs."""

import socket
from pathlib import Path

import pytest

from adatracker_deploy.core import ports
from adatracker_deploy.core.errors import PlatformError

KINDS = [pytest.param(socket.SOCK_STREAM, id="TCP"), pytest.param(socket.SOCK_DGRAM, id="UDP")]


def test_the_system_gives_them_to_no_socket_that_names_no_port():
    own = Path("/proc/sys/net/ipv4/ip_local_port_range")
    if not own.exists():
        pytest.skip("not Linux")
    first, last = map(int, own.read_text().split())
    if first < 32_768:
        pytest.skip(f"this machine gives {first} to {last}")
    assert not set(ports.BY_NUMBER) & set(range(first, last + 1))


@pytest.mark.parametrize("kind", KINDS)
def test_one_that_is_taken_is_passed_over(kind, monkeypatch):
    with socket.socket(socket.AF_INET, kind) as taken, socket.socket(socket.AF_INET, kind) as later:
        taken.bind(("127.0.0.1", 0))
        theirs, free = taken.getsockname()[1], ports.unused_port(kind)
        monkeypatch.setattr(ports, "BY_NUMBER", [theirs, free])
        assert {ports.unused_port(kind) for _ in range(20)} == {free}
        later.bind(("127.0.0.1", free))
        with pytest.raises(PlatformError, match="no free port"):
            ports.unused_port(kind)
