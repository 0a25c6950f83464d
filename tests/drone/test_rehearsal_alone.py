"""A rehearsal beside a foreign drone: it reaches its own simulator alone, or refuses."""

import contextlib
import dataclasses
import socket
import threading
import time

import pytest
from packing import packer
from pymavlink.dialects.v20 import common as mavlink
from watched import until

from adatracker_deploy.core.clock import MonotonicClock
from adatracker_deploy.core.errors import PlatformError
from adatracker_deploy.core.messages import Twist
from adatracker_deploy.core.ports import BY_NUMBER
from adatracker_deploy.platform import Scenario
from adatracker_deploy.registry import load_profile
from adatracker_drone.adapter.sender_filter import Guard
from adatracker_drone.platform import DronePlatform
from tests.tiers import EXHAUSTIVE

pytestmark = pytest.mark.slow

PX4S_OWN = 14540
"""Where a real PX4 sends, and where every profile waits for it."""


class Foreign(threading.Thread):
    """A PX4 vehicle that sends to some ports and answers nobody; what reaches it is counted."""

    def __init__(self, *ports):
        super().__init__()
        self.ports = set(ports)
        self.reached = b""
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(("127.0.0.1", 0))
        self._socket.setblocking(False)
        self._ended = threading.Event()
        self.start()

    def run(self):
        drone = packer()
        ready = 3 | mavlink.MAV_SYS_STATUS_PREARM_CHECK
        while not self._ended.wait(0.02):
            for message in (
                mavlink.MAVLink_heartbeat_message(2, 12, 81, 3 << 24 | 4 << 16, 3, 3),
                mavlink.MAVLink_sys_status_message(ready, ready, ready, 0, 0, 0, 90, *[0] * 6),
            ):
                for port in tuple(self.ports):
                    with contextlib.suppress(ConnectionRefusedError):
                        self._socket.sendto(message.pack(drone), ("127.0.0.1", port))
            with contextlib.suppress(BlockingIOError, ConnectionRefusedError):
                while True:
                    self.reached += self._socket.recv(2048)

    def close(self):
        self._ended.set()
        self.join()
        self._socket.close()


@contextlib.contextmanager
def rehearsal():
    """A simulator and an adapter that is not connected, by the shipped profile as it is."""
    clock = MonotonicClock(4.0)
    shipped = load_profile("px4_quad", DronePlatform)
    assert shipped.connection.url.endswith(f":{PX4S_OWN}")
    with DronePlatform.sitl(shipped) as sitl:
        reached = sitl.start(clock, Scenario(seed=1))
        with DronePlatform(reached, clock) as platform:
            yield platform


def drive(platform, seconds):
    end_s = time.monotonic() + seconds
    while time.monotonic() < end_s:
        platform.send(Twist(vx=0.5), platform.clock.now_ns())
        time.sleep(0.02)


def link_check(platform):
    return next(check for check in platform.preflight() if check.name == "link")


def port_of(platform):
    return int(platform.profile.connection.url.rpartition(":")[2])


def test_its_port_is_none_that_the_system_gives_to_somebody_else_before_it_is_opened():
    with rehearsal() as platform:
        assert port_of(platform) in BY_NUMBER


def test_a_foreign_drone_on_px4s_own_port_is_never_reached_and_the_rehearsal_flies_its_own():
    with contextlib.closing(Foreign(PX4S_OWN)) as foreign:
        with rehearsal() as platform:
            assert port_of(platform) != PX4S_OWN
            platform.connect()
            assert not [check for check in platform.preflight() if check.blocking and not check.ok]
            platform.engage()
            platform.disengage()
            assert platform.state().landed
        assert foreign.reached == b""


def test_a_foreign_drone_on_the_rehearsals_own_port_keeps_it_from_arming():
    with rehearsal() as platform, contextlib.closing(Foreign(port_of(platform))) as foreign:
        platform.connect()
        until(lambda: not link_check(platform).ok)
        assert link_check(platform).blocking
        with pytest.raises(PlatformError, match="somebody else sends"):
            platform.engage()
        assert platform.state().landed
        assert foreign.reached == b""


@EXHAUSTIVE
def test_a_foreign_drone_that_begins_to_talk_in_flight_ends_the_rehearsal():
    with rehearsal() as platform, contextlib.closing(Foreign()) as foreign:
        platform.connect()
        platform.preflight()
        platform.engage()
        platform.send(Twist(vx=0.5), platform.clock.now_ns())
        foreign.ports.add(port_of(platform))
        with pytest.raises(PlatformError, match="somebody else sends"):
            drive(platform, 5.0)
        platform.disengage()
        assert platform.state().landed
        assert foreign.reached == b""


def test_an_autopilot_that_is_not_this_runs_own_is_left_alone():
    with rehearsal() as platform:
        other = dataclasses.replace(platform.profile.connection, uid="0" * 36)
        profile = dataclasses.replace(platform.profile, connection=other)
        with (
            DronePlatform(profile, platform.clock) as stranger,
            pytest.raises(PlatformError, match="is another one, and is left alone"),
        ):
            stranger.connect()


def test_two_rehearsals_at_once_have_links_and_drones_of_their_own():
    with rehearsal() as one, rehearsal() as other:
        assert port_of(one) != port_of(other)
        assert one.profile.connection.uid != other.profile.connection.uid
        one.connect()
        other.connect()


def test_a_peer_that_is_known_beforehand_is_the_only_one_that_is_ever_heard():
    heartbeat = bytes(mavlink.MAVLink_heartbeat_message(2, 12, 0, 0, 3, 3).pack(packer()))
    guard = Guard(1, ("127.0.0.1", 5))
    assert guard.admit(heartbeat, ("127.0.0.1", 6), 0) == b""
    assert guard.peer == ("127.0.0.1", 5)
    assert guard.admit(heartbeat, ("127.0.0.1", 5), 0) == heartbeat
