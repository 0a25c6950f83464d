"""The link's sockets, with an autopilot and a stranger on this machine."""

import contextlib
import socket
import threading
import time

import pytest
from packing import KEY, heartbeat, packer

from adatracker_deploy.core.errors import UsageError
from adatracker_drone.adapter.sender_filter import Ignored
from adatracker_drone.adapter.udp import UdpLink
from adatracker_drone.protocol.packets import split
from adatracker_drone.protocol.signing import Signer


def talker(port=None):
    made = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    made.bind(("127.0.0.1", 0))
    made.settimeout(5.0)
    if port is not None:
        made.connect(("127.0.0.1", port))
    return made


def until(condition):
    pause, end_s = threading.Event(), time.monotonic() + 5.0
    while not condition():
        assert time.monotonic() < end_s, "waited in vain"
        pause.wait(0.002)


@contextlib.contextmanager
def link(signer=None):
    """A link that waits for its autopilot, which has just spoken; gives link, autopilot, what was heard."""
    with talker() as probe:
        address = probe.getsockname()
    heard = []
    with contextlib.closing(UdpLink(address, 1, signer, heard.append, binds=True)) as made:
        made.start()
        with talker(address[1]) as autopilot:
            autopilot.send(heartbeat(key=KEY if signer else None, time=10**17))
            until(lambda: heard)
            yield made, autopilot, heard


def test_what_is_said_goes_to_the_autopilot_from_the_port_that_it_knows():
    with link() as (made, autopilot, _):
        made.send(b"hello")
        assert autopilot.recv(100) == b"hello"  # it is connected: from any other port it would hear nothing


def test_what_was_queued_before_the_autopilot_was_known_is_heard_in_order():
    with talker() as probe:
        address = probe.getsockname()
    heard, count = [], 500
    with (
        contextlib.closing(UdpLink(address, 1, Signer(KEY), heard.append, binds=True)) as made,
        talker(address[1]) as autopilot,
    ):
        for number in range(count):
            autopilot.send(heartbeat(key=KEY, time=10**17 + number))
        made.start()
        for number in range(count, 2 * count):
            autopilot.send(heartbeat(key=KEY, time=10**17 + number))
        until(lambda: len(heard) == 2 * count)
        assert made.guard.offences == ""


def test_nothing_is_said_before_somebody_is_known():
    with talker() as probe:
        address = probe.getsockname()
    with contextlib.closing(UdpLink(address, 1, None, list, binds=True)) as made:
        made.start()
        made.send(heartbeat())
        assert made.guard.peer is None


def test_strangers_are_counted_and_the_autopilot_is_heard_behind_their_flood():
    with link() as (made, autopilot, heard), talker(autopilot.getpeername()[1]) as stranger:
        for _ in range(5000):
            stranger.send(heartbeat())
        before = len(heard)
        autopilot.send(heartbeat())
        until(lambda: len(heard) > before)
        until(lambda: made.guard.ignored[Ignored.STRANGER] > 100)
        assert len(heard) == before + 1
        assert made.guard.take_notices()
        made.send(b"still yours")
        assert autopilot.recv(100) == b"still yours"


def test_nobody_else_can_bind_the_port_beside_it():
    with link() as (_, autopilot, _), socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as thief:
        thief.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        with pytest.raises(OSError, match="in use"):
            thief.bind(autopilot.getpeername())


def test_a_taken_port_is_the_users_to_free():
    with talker() as other, pytest.raises(UsageError, match=r"cannot be used .*connection\.url"):
        UdpLink(other.getsockname(), 1, None, list, binds=True)


def test_what_goes_out_is_signed_where_there_is_a_key():
    with link(Signer(KEY)) as (made, autopilot, _):
        made.send(heartbeat(system=1, component=195))
        said = autopilot.recv(100)
        packer(key=KEY).decode(bytearray(said))
        (packet,) = split(said)
        assert packet.signed


def test_one_that_is_dialled_is_spoken_to_first():
    heard = []
    with (
        talker() as autopilot,
        contextlib.closing(UdpLink(autopilot.getsockname(), 1, None, heard.append, binds=False)) as made,
    ):
        made.start()
        made.send(heartbeat(component=195))
        _, host = autopilot.recvfrom(100)
        autopilot.sendto(heartbeat(), host)
        until(lambda: heard)
        with talker() as stranger:
            stranger.sendto(heartbeat(), host)  # the kernel lets no stranger in
        autopilot.sendto(heartbeat(), host)
        until(lambda: len(heard) == 2)
        assert made.guard.offences == ""


def test_closing_twice_and_saying_something_afterwards_is_no_harm():
    with link() as (made, _, _):
        made.close()
        made.send(b"too late")
