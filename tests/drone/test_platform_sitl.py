"""The drone's adapter through real MAVSDK against the simulated PX4: its promises, and what goes wrong."""

import contextlib
import dataclasses
import select
import socket
import threading
import time
from typing import ClassVar

import pytest
from pymavlink.dialects.v20 import common as mavlink

from adatracker_deploy.core.clock import MonotonicClock
from adatracker_deploy.core.errors import PlatformError
from adatracker_deploy.core.messages import ZERO, Twist
from adatracker_deploy.core.ports import unused_port
from adatracker_deploy.platform import Scenario
from adatracker_deploy.registry import load_profile
from adatracker_deploy.testing.conformance import PlatformConformance
from adatracker_drone.platform import DronePlatform
from tests.driving import send_for
from tests.tiers import EXHAUSTIVE

pytestmark = pytest.mark.slow

SET_POINTS = {
    Twist(vx=0.5): (b'"coordinate_frame": 8'.hex(), b'"vx": 0.5'.hex()),
    Twist(yaw_rate=0.25): b'"yaw_rate": -0.25'.hex(),  # clockwise is positive
}
"""SET_POSITION_TARGET_LOCAL_NED by MAVLink's common.xml, as MAVSDK takes it; 8 is MAV_FRAME_BODY_NED."""
POSCTL, HOLD = (3, 0), (4, 3)
"""PX4's main and sub modes."""


def free_port() -> int:
    return unused_port(socket.SOCK_DGRAM)


def rehearsal_profile(**sitl):
    """The shipped profile on a free port."""
    profile = load_profile("px4_quad", DronePlatform)
    return dataclasses.replace(
        profile,
        connection=dataclasses.replace(profile.connection, url=f"udpin://127.0.0.1:{free_port()}"),
        sitl=dataclasses.replace(profile.sitl, **sitl),
    )


class AgainstTheManual(PlatformConformance):
    manual: ClassVar = SET_POINTS
    says = "adatracker_drone.adapter.transport:set_point_json"

    def said(self, *values):
        return values[-1].encode()


@EXHAUSTIVE
class TestDroneInSitl(AgainstTheManual):
    platform_class = DronePlatform
    clock_speed = 5.0
    cruise_m_s = 1.0
    still_m_s = 0.5  # flown by velocity alone it drifts by its estimate's error
    body_height_m = 2.0

    @pytest.fixture(scope="class")
    @classmethod
    def profile(cls):
        return rehearsal_profile()


class GroundStation:
    """A second MAVLink end that a pilot could hold: it hears the vehicle and switches its mode."""

    def __init__(self) -> None:
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(("127.0.0.1", 0))
        self._socket.settimeout(10.0)
        self._mavlink = mavlink.MAVLink(None, srcSystem=255, srcComponent=190)
        self.url = f"udpout:127.0.0.1:{self._socket.getsockname()[1]}"

    def switch(self, mode: tuple[int, int]) -> None:
        _, vehicle = self._socket.recvfrom(2048)
        command = self._mavlink.command_long_encode(
            1, 1, mavlink.MAV_CMD_DO_SET_MODE, 0, 1, mode[0], mode[1], 0, 0, 0, 0
        )
        self._socket.sendto(command.pack(self._mavlink), vehicle)

    def close(self) -> None:
        self._socket.close()


class Radio(threading.Thread):
    """Relays between the simulator, which sends to `far_port`, and the adapter, until the link is cut."""

    def __init__(self, far_port: int, near_port: int) -> None:
        super().__init__(daemon=True)
        self.up = threading.Event()
        self.up.set()
        self._open = True
        self._near = ("127.0.0.1", near_port)
        self._far_socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._far_socket.bind(("127.0.0.1", far_port))
        self._near_socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._near_socket.bind(("127.0.0.1", 0))
        self.near_source = f"127.0.0.1:{self._near_socket.getsockname()[1]}"

    def run(self) -> None:
        far = None
        while self._open:
            for ready in select.select([self._far_socket, self._near_socket], [], [], 0.1)[0]:
                with contextlib.suppress(ConnectionRefusedError):  # nobody listens on that side yet
                    packet, sender = ready.recvfrom(2048)
                    if ready is self._far_socket:
                        far = sender
                    if self.up.is_set() and ready is self._far_socket:
                        self._near_socket.sendto(packet, self._near)
                    elif self.up.is_set() and far is not None:
                        self._far_socket.sendto(packet, far)

    def close(self) -> None:
        self._open = False
        self.join()
        self._far_socket.close()
        self._near_socket.close()


@contextlib.contextmanager
def flight(profile, speed=1.0):
    """A connected adapter on a simulator of its own; at the end the drone is down."""
    clock = MonotonicClock(speed)
    with (
        DronePlatform.sitl(profile) as sitl,
        DronePlatform(sitl.start(clock, Scenario(seed=1)), clock) as platform,
    ):
        platform.connect()
        assert all(check.ok for check in platform.preflight() if check.blocking)
        yield platform


def until(platform, condition, within_s):
    """Wait for the state to meet `condition`; return the machine's seconds that it took."""
    begin = time.monotonic()
    while not condition(platform.state()):
        assert time.monotonic() - begin < within_s, platform.state()
        platform.clock.sleep_until(platform.clock.now_ns() + 5_000_000)
    return time.monotonic() - begin


def at_rest(state):
    return abs(state.velocity.vx) < 0.3 and abs(state.velocity.vy) < 0.3


@EXHAUSTIVE
def test_a_start_is_short_and_prints_nothing(capfd):
    took = {}
    clock = MonotonicClock()
    begin = time.monotonic()

    def mark(phase: str) -> None:
        took[phase] = time.monotonic() - begin

    with DronePlatform.sitl(rehearsal_profile()) as sitl:
        profile = sitl.start(clock, Scenario(seed=1))
        mark("simulator")
        with DronePlatform(profile, clock) as platform:
            platform.connect()
            mark("connected")
            platform.preflight()
            mark("checked")
            engaging = threading.Thread(target=platform.engage)
            engaging.start()
            until(platform, lambda state: state.pose.z > 0.3, within_s=20.0)
            mark("airborne")
            engaging.join()
            mark("offboard")
            platform.disengage()
        mark("landed")
    assert capfd.readouterr() == ("", "")
    print(", ".join(f"{phase} {seconds:.2f} s" for phase, seconds in took.items()))
    assert took["airborne"] < 10.0


@EXHAUSTIVE
def test_a_pilot_who_switches_the_mode_has_the_drone_for_good():
    station = GroundStation()
    with contextlib.closing(station), flight(rehearsal_profile(gcs=station.url)) as platform:
        platform.engage()
        send_for(platform, Twist(vx=1.0), 1.0)
        station.switch(POSCTL)
        took_s = until(platform, lambda state: state.stopped, within_s=3.0)
        assert platform.state().taken_over
        print(f"takeover noticed after {took_s:.2f} s")
        assert "POSCTL" in platform.state().stopped
        with pytest.raises(PlatformError, match="POSCTL"):
            platform.send(Twist(vx=1.0), platform.clock.now_ns())
        platform.hold("too late")
        platform.disengage()
        with pytest.raises(PlatformError, match="not in HOLD"):
            platform.engage()
        assert platform.state().mode == "POSCTL"
        assert not platform.state().landed
        station.switch(HOLD)
        until(platform, lambda state: state.mode == "HOLD", within_s=3.0)
        platform.engage()
        assert platform.state().engaged
        platform.disengage()
        assert platform.state().landed


@EXHAUSTIVE
def test_a_hang_at_1_m_s_is_ended_by_the_autopilots_fail_safe():
    with flight(rehearsal_profile()) as platform:
        platform.engage()
        send_for(platform, Twist(vx=1.0), 3.0)
        start = platform.state().pose
        landing_s = until(platform, lambda state: state.mode == "LAND", within_s=4.0)
        rest_s = landing_s + until(platform, at_rest, within_s=5.0)
        end = platform.state().pose
        print(
            f"after the last set-point: LAND heard after {landing_s:.2f} s, at rest after {rest_s:.2f} s "
            f"and {start.distance_to(end.x, end.y):.2f} m"
        )
        assert start.distance_to(end.x, end.y) < 3.0
        with pytest.raises(PlatformError, match="LAND"):
            platform.send(ZERO, platform.clock.now_ns())
        platform.disengage()
        assert platform.state().landed


@EXHAUSTIVE
def test_a_lost_link_stops_the_stream_for_good_and_the_autopilot_lands():
    near_port = free_port()
    clock = MonotonicClock()
    with DronePlatform.sitl(rehearsal_profile()) as sitl:
        far = sitl.start(clock, Scenario(seed=1))
        radio = Radio(int(far.connection.url.rpartition(":")[2]), near_port)
        radio.start()
        near = dataclasses.replace(
            far,
            connection=dataclasses.replace(
                far.connection, url=f"udpin://127.0.0.1:{near_port}", peer=radio.near_source
            ),
        )
        with contextlib.closing(radio), DronePlatform(near, clock) as platform:
            platform.connect()
            platform.preflight()
            platform.engage()
            send_for(platform, Twist(vx=1.0), 2.0)
            radio.up.clear()
            cut = time.monotonic()
            with pytest.raises(PlatformError, match="no position"):
                send_for(platform, Twist(vx=1.0), 5.0)
            print(f"link lost: the stream stopped after {time.monotonic() - cut:.2f} s")
            assert time.monotonic() - cut < 1.0
            clock.sleep_until(clock.now_ns() + 1_500_000_000)  # the autopilot notices
            radio.up.set()
            until(platform, lambda state: state.mode == "LAND", within_s=5.0)
            with pytest.raises(PlatformError, match="no position"):
                platform.send(ZERO, clock.now_ns())
            platform.disengage()
            assert platform.state().landed


@EXHAUSTIVE
def test_the_altitude_holds_against_the_bias_of_the_velocity_estimate():
    with flight(rehearsal_profile(), speed=5.0) as platform:
        platform.engage()
        before = platform.state().pose.z
        heights = []
        for _ in range(15):
            send_for(platform, Twist(vx=0.5, yaw_rate=0.3), 2.0)
            heights.append(platform.state().pose.z)
        print(f"height over 30 s: {before:.2f} m, then {min(heights):.2f} to {max(heights):.2f} m")
        assert max(abs(height - before) for height in heights) < 0.4
        platform.disengage()
        assert platform.state().landed
