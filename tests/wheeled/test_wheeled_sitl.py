"""The simulator as a process: strangers drive it, it can be killed and frozen, and it ends at rest."""

import contextlib
import dataclasses
import os
import signal
import subprocess
import sys
import threading
import time
import urllib.request

import can
import pytest
from wheeled_rig import until

from adatracker_deploy.core.clock import MonotonicClock
from adatracker_deploy.core.errors import PlatformError, UsageError
from adatracker_deploy.core.messages import Twist
from adatracker_deploy.perception.sources import open_source
from adatracker_deploy.platform import Scenario
from adatracker_deploy.registry import load_profile
from adatracker_wheeled.platform import WheeledPlatform
from adatracker_wheeled.protocol.bus import Bus
from adatracker_wheeled.protocol.codec import Codec
from adatracker_wheeled.sim.faults import injection
from adatracker_wheeled.sim.sitl import WheeledSitl, main
from tests.by_hand import simulator_by_hand
from tests.driving import send_for
from tests.tiers import EXHAUSTIVE, sampled

pytestmark = pytest.mark.slow

AHEAD = Twist(vx=0.5)


@contextlib.contextmanager
def rehearsal(profile=None, speed=1.0):
    """A simulator in its process, drawn seldom; give (sitl, the profile that reaches it, clock)."""
    profile, clock = profile or load_profile("scout", WheeledPlatform), MonotonicClock(speed)
    camera = dataclasses.replace(profile.camera, rate_hz=5.0)
    with WheeledSitl(dataclasses.replace(profile, camera=camera)) as sitl:
        yield sitl, sitl.start(clock, Scenario(seed=1)), clock


@contextlib.contextmanager
def engaged(profile, clock):
    with WheeledPlatform(profile, clock) as platform:
        platform.connect()
        assert all(check.ok for check in platform.preflight() if check.blocking)
        platform.engage()
        yield platform


class Witness:
    """Somebody else on the bus: hears how fast the base is, and can make things go wrong."""

    def __init__(self, profile):
        self._codec = Codec(profile.connection.roles)
        self.speed_m_s = 0.0
        self.mode = ""
        self._bus = Bus.open(profile.connection, self._hear)

    def _hear(self, frame):
        reading = frame and self._codec.parse(frame)
        if reading and reading.motion:
            self.speed_m_s = abs(reading.motion.vx)
        if reading and reading.status:
            self.mode = reading.status.mode

    def inject(self, fault, *, begin=True):
        assert self._bus.send(injection(fault, begin=begin))

    def close(self):
        self._bus.close()


def test_a_rehearsal_starts_soon_and_prints_nothing(capfd):
    begun_s, took = time.monotonic(), {}
    with rehearsal() as (_, profile, clock):
        took["up"] = time.monotonic() - begun_s
        with WheeledPlatform(profile, clock) as platform:
            platform.connect()
            took["connected"] = time.monotonic() - begun_s
            platform.preflight()
            took["checked"] = time.monotonic() - begun_s
            platform.engage()
            took["engaged"] = time.monotonic() - begun_s
            platform.disengage()
    took["ended"] = time.monotonic() - begun_s
    assert capfd.readouterr() == ("", "")
    print(", ".join(f"{phase} {seconds:.2f} s" for phase, seconds in took.items()))
    assert took["engaged"] < 6.0


@EXHAUSTIVE
def test_the_camera_shows_what_the_base_does_and_go_lets_the_person_walk():
    with rehearsal() as (_, profile, clock):
        camera = open_source(profile.camera.uri, clock)
        camera.open()
        try:
            with engaged(profile, clock) as platform:

                def truth():
                    return camera.read(clock.now_ns()).truth

                begin = truth()
                send_for(platform, AHEAD, 2.0)
                until(lambda: truth().robot != begin.robot)
                assert begin.robot.distance_to(truth().robot.x, truth().robot.y) > 0.5
                assert truth().target_xy == begin.target_xy
                camera.go()
                until(lambda: truth().target_xy != begin.target_xy)
                platform.disengage()
        finally:
            camera.close()


@EXHAUSTIVE
def test_odometry_drifts_from_the_truth_by_the_slip():
    scout = load_profile("scout", WheeledPlatform)
    slippery = dataclasses.replace(scout, sitl=dataclasses.replace(scout.sitl, slip=0.2))
    with rehearsal(slippery, speed=2.0) as (_, profile, clock):
        camera = open_source(profile.camera.uri, clock)
        camera.open()
        try:
            with engaged(profile, clock) as platform:
                begin = camera.read(clock.now_ns()).truth.robot
                send_for(platform, AHEAD, 4.0)
                platform.disengage()
                believed = platform.state().pose
                end = until_still(camera, clock)
        finally:
            camera.close()
    moved = begin.distance_to(end.x, end.y)
    assert 0.005 < 1 - moved / believed.x < 0.2


def until_still(camera, clock):
    """Return the robot's true pose once it has stopped changing."""
    poses = [None]

    def still():
        poses.append(camera.read(clock.now_ns()).truth.robot)
        threading.Event().wait(0.1)
        return poses[-1] == poses[-2]

    until(still)
    return poses[-1]


def test_a_stranger_drives_it_with_python_can_alone():
    with rehearsal() as (_, profile, _), contextlib.closing(Witness(profile)) as witness:
        address = {"host": profile.connection.host, "port": profile.connection.port}
        with can.Bus(interface="socketcand", channel="can0", **address) as bus:
            bus.send(can.Message(arbitration_id=0x421, data=b"\x01", is_extended_id=False))
            half_m_s = (500).to_bytes(2, "big") + bytes(6)

            def moving():
                bus.send(can.Message(arbitration_id=0x111, data=half_m_s, is_extended_id=False))
                return witness.speed_m_s > 0.45

            until(moving)
            stopped_s = until(lambda: witness.speed_m_s < 0.02)
            print(f"silence at 0.5 m/s: at rest after {stopped_s:.2f} s")
            assert 0.5 < stopped_s < 1.2


@pytest.mark.parametrize("fault", sampled(("remote", "emergency_stop", "silence"), everyday=("remote",)))
def test_faults_are_injected_over_the_bus(fault):
    with (
        rehearsal() as (_, profile, clock),
        contextlib.closing(Witness(profile)) as witness,
        engaged(profile, clock) as platform,
    ):
        send_for(platform, AHEAD, 0.5)
        witness.inject(fault)
        took_s = until(lambda: platform.state().stopped)
        print(f"{fault}: stopped after {took_s * 1e3:.0f} ms")
        assert took_s < 0.5


def test_a_simulator_that_is_killed_is_noticed_at_once():
    with rehearsal() as (sitl, profile, clock), engaged(profile, clock) as platform:
        send_for(platform, AHEAD, 0.5)
        os.kill(sitl.pid, signal.SIGKILL)
        begun_s = time.monotonic()
        with pytest.raises(PlatformError, match="is lost"):
            send_for(platform, AHEAD, 3.0)
        print(f"simulator killed: latched after {(time.monotonic() - begun_s) * 1e3:.0f} ms")
        assert time.monotonic() - begun_s < 0.2


def test_a_simulator_that_is_frozen_is_noticed_and_does_not_move_when_it_wakes():
    with rehearsal() as (sitl, profile, clock), engaged(profile, clock) as platform:
        send_for(platform, AHEAD, 0.5)
        os.kill(sitl.pid, signal.SIGSTOP)
        try:
            begun_s = time.monotonic()
            with pytest.raises(PlatformError, match="no measured motion"):
                send_for(platform, AHEAD, 3.0)
            print(f"simulator frozen: latched after {(time.monotonic() - begun_s) * 1e3:.0f} ms")
            assert time.monotonic() - begun_s < 0.35
        finally:
            os.kill(sitl.pid, signal.SIGCONT)
        until(lambda: platform.state().age_s(clock.now_ns()) < 0.1)
        before = platform.state().pose
        clock.sleep_until(clock.now_ns() + 700_000_000)
        after = platform.state().pose
        assert before.distance_to(after.x, after.y) < 0.5
        assert abs(platform.state().velocity.vx) < 0.02


DRIVER = """
import signal, sys
signal.signal(signal.SIGINT, signal.default_int_handler)  # which background jobs ignore
from adatracker_deploy.core.messages import Twist
from adatracker_deploy.registry import load_profile
from adatracker_deploy.core.clock import MonotonicClock
from adatracker_wheeled.platform import WheeledPlatform
import dataclasses
profile = load_profile("scout", WheeledPlatform)
connection = dataclasses.replace(
    profile.connection, interface="socketcand", channel="can0", port=int(sys.argv[1])
)
clock = MonotonicClock()
with WheeledPlatform(dataclasses.replace(profile, connection=connection), clock) as platform:
    platform.connect()
    platform.engage()
    while True:
        platform.send(Twist(vx=0.5), clock.now_ns())
        clock.sleep_until(clock.now_ns() + 20_000_000)
"""


@pytest.mark.parametrize(
    "number", sampled((signal.SIGKILL, signal.SIGSTOP, signal.SIGINT), everyday=(signal.SIGKILL,))
)
def test_the_base_stops_whatever_happens_to_the_process_that_drives_it(number):
    with (
        rehearsal() as (_, profile, _),
        contextlib.closing(Witness(profile)) as witness,
        subprocess.Popen(
            [sys.executable, "-c", DRIVER, str(profile.connection.port)], stderr=subprocess.DEVNULL
        ) as driver,
    ):
        try:
            until(lambda: witness.speed_m_s > 0.49, within_s=20.0)
            driver.send_signal(number)
            stopped_s = until(lambda: witness.speed_m_s < 0.02)
            print(f"{number.name} at 0.5 m/s: at rest after {stopped_s:.2f} s")
            assert stopped_s < (0.8 if number is signal.SIGINT else 1.2)
            if number is signal.SIGINT:
                until(lambda: witness.mode == "standby")
        finally:
            driver.kill()


def test_it_outlives_its_lifeline_until_the_base_stands():
    with WheeledSitl(load_profile("scout", WheeledPlatform)) as sitl:
        clock = MonotonicClock()
        profile = sitl.start(clock, Scenario(seed=1))
        with engaged(profile, clock) as platform, contextlib.closing(Witness(profile)) as witness:
            send_for(platform, AHEAD, 1.0)
            closing = threading.Thread(target=sitl.close)
            closing.start()
            send_for(platform, AHEAD, 0.5)
            assert witness.speed_m_s > 0.4
            platform.disengage()
            closing.join(5.0)
            assert not closing.is_alive()


@EXHAUSTIVE
def test_time_runs_as_fast_as_the_shared_clock():
    with rehearsal(speed=3.0) as (_, profile, clock), engaged(profile, clock) as platform:
        send_for(platform, AHEAD, 2.0)
        before, begun_s = platform.state().pose, time.monotonic()
        send_for(platform, AHEAD, 5.0)
        after = platform.state().pose
        assert time.monotonic() - begun_s == pytest.approx(5.0 / 3.0, abs=0.2)
        assert before.distance_to(after.x, after.y) == pytest.approx(2.5, abs=0.3)


def test_by_hand_it_takes_a_profile_and_a_port_and_says_where_its_camera_is():
    with simulator_by_hand("adatracker_wheeled.sim.sitl", "--profile", "tracer", "--lifeline") as there:
        with urllib.request.urlopen(there.ready["camera"], timeout=5) as stream:
            assert b"--frame" in stream.read(100)
        there.process.stdin.close()
        assert there.process.wait(5.0) == 0


@pytest.mark.parametrize(
    ("asked", "said"),
    [
        (["--profile", "unicycle"], "unknown profile 'unicycle'"),
        (["--profile", "go2"], "is a profile for platform 'quadruped', not 'wheeled'"),
        (["--port", "70000"], "--port 70000: expected 0 to 65535"),
        (["--camera-port", "-1"], "--camera-port -1: expected 0 to 65535"),
    ],
)
def test_what_cannot_be_is_refused_in_a_line(capsys, asked, said):
    assert main(asked) == 2
    (line,) = capsys.readouterr().out.splitlines()
    assert said in line


def test_a_port_in_use_is_refused_in_a_line(capsys):
    with rehearsal() as (_, profile, _):
        assert main(["--port", str(profile.connection.port)]) == 2
        assert "in use" in capsys.readouterr().out.lower()


def test_settings_that_cannot_be_are_refused_before_anything_starts():
    scout = load_profile("scout", WheeledPlatform)
    roles = dataclasses.replace(scout.connection.roles, dbc="nowhere.dbc")
    broken = dataclasses.replace(scout, connection=dataclasses.replace(scout.connection, roles=roles))
    with pytest.raises(UsageError, match=r"nowhere\.dbc"):
        WheeledSitl(broken).start(MonotonicClock(), Scenario())
