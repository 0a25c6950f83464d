"""The simulated robot as a process: who may walk it, how it begins and how it ends."""

import subprocess
import sys
import time

import pytest

from adatracker_deploy.core.clock import MonotonicClock
from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.core.messages import Twist
from adatracker_deploy.platform import Scenario
from adatracker_quadruped.adapter.command_publisher import Commander
from adatracker_quadruped.adapter.subscriber import Subscriber
from adatracker_quadruped.platform import QuadrupedPlatform
from adatracker_quadruped.protocol.cdr import SMALL_CAP_BYTES
from adatracker_quadruped.protocol.keys import Keys
from adatracker_quadruped.protocol.messages import decode_imu, decode_odometry
from adatracker_quadruped.protocol.session import open_session
from tests.driving import send_for
from tests.quadruped.rehearsal import by_hand, connected, rehearsed, simulator, speed
from tests.quadruped.routers import free_port, until
from tests.tiers import EXHAUSTIVE

pytestmark = pytest.mark.slow

WALK = Twist(vx=1.0)


def started(*arguments):
    return subprocess.run(
        [sys.executable, "-m", "adatracker_quadruped.sim.sitl", *arguments],
        capture_output=True,
        text=True,
        check=False,
        timeout=30,
    )


def tap(session, profile, topic, decode):
    return Subscriber(
        session, getattr(Keys(profile.connection), topic), decode, MonotonicClock(), SMALL_CAP_BYTES
    )


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["--scenario", '{"scene": "the_moon"}'], "the_moon"),
        (["--profile", "px4_quad"], "is a profile for platform 'drone'"),
        (["--robot", '{"camera_hz": 20}'], "missing key"),
        (["--robot", "no JSON"], "Expecting value"),
        (["--scenario", '{"target_speed_m_s": 6}'], "expected 0 to 5"),
    ],
)
def test_what_cannot_be_is_refused_in_one_line_with_status_2(arguments, says):
    done = started("--listen", f"tcp/127.0.0.1:{free_port()}", *arguments)
    assert done.returncode == 2
    assert says in done.stdout
    assert done.stdout.count("\n") == 1


def test_it_listens_on_this_machine_alone():
    done = started("--listen", "tcp/0.0.0.0:7447")
    assert done.returncode == 2
    assert "is not tcp/127.0.0.1:PORT" in done.stderr


def test_a_port_that_is_taken_is_said_in_one_line():
    port = free_port()
    with by_hand(port):
        done = started("--listen", f"tcp/127.0.0.1:{port}")
    assert done.returncode == 1
    assert f"cannot listen at tcp/127.0.0.1:{port}" in done.stdout


def test_a_scene_that_does_not_exist_is_a_wrong_request():
    with QuadrupedPlatform.sitl(rehearsed()) as sitl, pytest.raises(UsageError, match="the_moon"):
        sitl.start(MonotonicClock(), Scenario(scene="the_moon"))


def test_a_script_that_knows_no_token_walks_it_too():
    with simulator() as (_, profile), open_session(profile.connection) as session:
        odometry = tap(session, profile, "odometry", decode_odometry)
        commander = Commander(session, profile.connection)
        until(lambda: commander.matched)

        def walking():
            commander.walk(WALK, time.time_ns())
            return odometry.newest is not None and odometry.newest.value.velocity.vx > 0.8

        until(walking)
        until(lambda: odometry.newest.value.velocity.vx < 0.01)  # by its own time-out


def test_it_tells_of_itself_at_the_rates_of_its_settings():
    with simulator() as (_, profile), open_session(profile.connection) as session:
        taps = {
            "odometry": tap(session, profile, "odometry", decode_odometry),
            "imu": tap(session, profile, "imu", decode_imu),
        }
        until(lambda: all(tap.newest for tap in taps.values()))
        before = {name: tap.newest.count for name, tap in taps.items()}
        clock = MonotonicClock()
        clock.sleep_until(clock.now_ns() + 2_000_000_000)
        rates_hz = {name: (tap.newest.count - before[name]) / 2.0 for name, tap in taps.items()}
        print(rates_hz)
        assert 35 < rates_hz["odometry"] < 51
        assert 65 < rates_hz["imu"] < 102


@EXHAUSTIVE
def test_it_ends_with_its_lifeline_at_once_when_it_stands_and_after_a_stop_when_it_walks():
    with simulator() as (sitl, profile):
        begin = time.monotonic()
        sitl.close()
        assert time.monotonic() - begin < 1.0
    with simulator() as (sitl, profile), connected(profile) as platform:
        platform.engage()
        send_for(platform, WALK, 1.0)
        assert speed(platform) > 0.5
        begin = time.monotonic()
        sitl.close()
        assert 0.3 < time.monotonic() - begin < 3.0
        assert speed(platform) < 0.1
