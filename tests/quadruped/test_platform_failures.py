"""The host stops if the robot or the connection fails, says why, and never resumes by itself."""

import contextlib
import os
import re
import signal
import threading
import time

import pytest

from adatracker_deploy.core.clock import MonotonicClock
from adatracker_deploy.core.errors import PlatformError
from adatracker_deploy.core.geometry import Pose
from adatracker_deploy.core.messages import ZERO, Twist
from adatracker_deploy.perception.zenoh_session import dial
from adatracker_quadruped.adapter.transport import Wire
from adatracker_quadruped.platform import QuadrupedPlatform
from adatracker_quadruped.protocol.connection import Connection
from adatracker_quadruped.protocol.keys import Keys
from adatracker_quadruped.protocol.messages import Odometry, encode_odometry
from adatracker_quadruped.protocol.publisher import Publisher
from adatracker_quadruped.protocol.rehearsal_keys import Fault
from tests.driving import engages, send_for
from tests.other_machine import OfAnotherMachine
from tests.quadruped.rehearsal import by_hand, connected, goes_wrong, moved, rehearsed, simulator, speed
from tests.quadruped.routers import free_port, robot, until
from tests.tiers import EXHAUSTIVE

pytestmark = pytest.mark.slow

WALK = Twist(vx=1.0)
PATIENCE_S = 2.5
"""The connection's two seconds, and what this machine adds."""


def refused(platform):
    """Return the names of the preflight checks that forbid engaging."""
    return [check.name for check in platform.preflight() if check.blocking and not check.ok]


def walks_until_it_fails(platform, match):
    """Send commands until the adapter refuses one; return how long that took, in the machine's seconds."""
    begin = time.monotonic()
    with pytest.raises(PlatformError, match=match):
        send_for(platform, WALK, 5.0)
    return time.monotonic() - begin


def stays_stopped(platform, why):
    assert not platform.state().engaged
    assert why in platform.state().stopped
    for _ in range(5):
        with pytest.raises(PlatformError, match=re.escape(why)):
            platform.send(WALK, platform.clock.now_ns())


def walks_again(platform):
    """Check that an explicit engage is obeyed once the robot is heard again."""
    until(lambda: engages(platform), 8.0)
    send_for(platform, WALK, 1.0)
    assert speed(platform) > 0.5
    platform.hold("enough")


# At the start


def test_nobody_at_the_endpoint_is_said_within_two_seconds():
    profile = rehearsed(endpoint=f"tcp/127.0.0.1:{free_port()}")
    begin = time.monotonic()
    with (
        QuadrupedPlatform(profile, MonotonicClock()) as platform,
        pytest.raises(PlatformError, match="no Zenoh router or bridge answers"),
    ):
        platform.connect()
    assert time.monotonic() - begin < PATIENCE_S


def test_a_router_without_a_robot_is_said_within_two_seconds():
    connection = Connection(endpoint=f"tcp/127.0.0.1:{free_port()}")
    begin = time.monotonic()
    with (
        robot(connection),
        QuadrupedPlatform(rehearsed(endpoint=connection.endpoint), MonotonicClock()) as platform,
        pytest.raises(PlatformError, match="answers, but no odometry came on odom"),
    ):
        platform.connect()
    assert time.monotonic() - begin < PATIENCE_S


def test_a_robot_that_stays_silent_is_said_within_two_seconds():
    with simulator() as (_, profile):
        goes_wrong(profile, Fault.SILENT)
        with contextlib.closing(Wire(profile.connection, MonotonicClock())) as wire:
            until(lambda: not wire.hears("odom", 0.2))
        begin = time.monotonic()
        with (
            QuadrupedPlatform(profile, MonotonicClock()) as platform,
            pytest.raises(PlatformError, match="no odometry"),
        ):
            platform.connect()
        assert time.monotonic() - begin < PATIENCE_S


def test_a_robot_that_listens_to_no_command_is_not_engaged():
    profile = rehearsed(
        endpoint=f"tcp/127.0.0.1:{free_port()}",
        imu_topic="",
        battery_topic="",
        min_battery=0.0,
        robot_liveliness="",
    )
    with robot(profile.connection) as session, QuadrupedPlatform(profile, MonotonicClock()) as platform:
        odometry = Publisher(session, "odom", attaches=False)

        def heard():
            unix_ns = time.time_ns()
            odometry.put(encode_odometry(Odometry(Pose(), ZERO, unix_ns)), unix_ns)
            return platform.state().t_ns

        connecting = threading.Thread(target=platform.connect)
        connecting.start()
        until(heard)
        connecting.join()
        heard()
        with pytest.raises(PlatformError, match="nobody subscribes to cmd_vel"):
            platform.engage()
        assert "command topic" in refused(platform)


@pytest.mark.parametrize(("fault", "check"), [(Fault.LOW_BATTERY, "battery"), (Fault.TIPPED_OVER, "upright")])
def test_the_preflight_refuses_a_robot_that_is_not_fit(fault, check):
    with simulator() as (_, profile):
        goes_wrong(profile, fault)
        with QuadrupedPlatform(profile, MonotonicClock()) as platform:
            platform.connect()
            until(lambda: refused(platform) == [check])


@EXHAUSTIVE
def test_a_second_host_is_refused_until_the_first_has_left(monkeypatch):
    monkeypatch.setattr("adatracker_quadruped.adapter.transport.Claim", OfAnotherMachine)
    with simulator() as (_, profile):
        with connected(profile) as first:
            with QuadrupedPlatform(profile, MonotonicClock()) as second:
                second.connect()
                assert refused(second) == ["only host"]
                with pytest.raises(PlatformError, match="another host"):
                    second.engage()
            first.engage()
            send_for(first, WALK, 0.5)
        with connected(profile) as third:
            third.engage()


# On the way


@EXHAUSTIVE
def test_a_host_that_paused_does_not_set_a_robot_going_that_has_stopped_by_itself():
    with simulator() as (_, profile), connected(profile) as platform:
        platform.engage()
        send_for(platform, WALK, 0.5)
        paused_s = profile.connection.command_timeout_s + 0.1
        platform.clock.sleep_until(platform.clock.now_ns() + round(paused_s * 1e9))
        with pytest.raises(PlatformError, match="no command for"):
            platform.send(WALK, platform.clock.now_ns())
        stays_stopped(platform, "no command for")
        walks_again(platform)


def test_closing_while_another_thread_disengages_is_no_error(monkeypatch):
    with simulator() as (_, profile), connected(profile) as platform:
        platform.engage()
        send_for(platform, WALK, 0.2)
        pauses = []

        def closes_after_the_last_zero(seconds):
            pauses.append(seconds)
            if len(pauses) == 3:
                platform.close()

        monkeypatch.setattr("adatracker_quadruped.adapter.adapter.time.sleep", closes_after_the_last_zero)
        platform.disengage()
        assert not platform.state().engaged


def test_a_killed_robot_is_noticed_within_a_fifth_of_a_second():
    with simulator() as (sitl, profile), connected(profile) as platform:
        platform.engage()
        send_for(platform, WALK, 0.5)
        os.kill(sitl.pid, signal.SIGKILL)
        took_s = walks_until_it_fails(platform, "the robot is gone")
        print(f"robot killed: latched after {took_s * 1e3:.0f} ms")
        assert took_s < 0.2
        stays_stopped(platform, "the robot is gone")


@EXHAUSTIVE
def test_a_frozen_robot_is_noticed_and_a_thawed_one_does_not_walk():
    with simulator() as (sitl, profile), connected(profile) as platform:
        platform.engage()
        send_for(platform, WALK, 1.0)
        os.kill(sitl.pid, signal.SIGSTOP)
        took_s = walks_until_it_fails(platform, "no odometry")
        print(f"robot frozen: latched after {took_s * 1e3:.0f} ms")
        assert took_s < 0.3 + 0.1
        platform.hold("frozen")
        platform.clock.sleep_until(platform.clock.now_ns() + 2_500_000_000)  # longer than the lease
        frozen_at, frozen_t_ns = platform.state().pose, platform.state().t_ns
        os.kill(sitl.pid, signal.SIGCONT)
        until(lambda: platform.state().t_ns > frozen_t_ns, 5.0)
        rolled_m = moved(platform, frozen_at, 1.5)
        print(f"robot thawed: went {rolled_m:.2f} m more")
        assert rolled_m < 0.35  # what it takes to stop from 1 m/s
        assert speed(platform) < 0.01
        stays_stopped(platform, "no odometry")
        walks_again(platform)


@EXHAUSTIVE
def test_a_disengaged_robot_stands_and_one_that_is_not_seen_to_stand_is_told():
    with simulator() as (sitl, profile), connected(profile) as platform:
        platform.engage()
        send_for(platform, WALK, 1.0)
        platform.disengage()
        assert speed(platform) < 0.1
        platform.engage()
        send_for(platform, WALK, 0.5)
        os.kill(sitl.pid, signal.SIGKILL)
        with pytest.raises(PlatformError, match="not seen to stand"):
            platform.disengage()
        assert not platform.state().engaged


def test_a_router_that_is_gone_and_comes_back_resumes_nothing():
    port = free_port()
    profile = rehearsed(endpoint=f"tcp/127.0.0.1:{port}")
    with by_hand(port) as there:
        platform = QuadrupedPlatform(profile, MonotonicClock())
        platform.connect()
        platform.engage()
        send_for(platform, WALK, 0.5)
        there.process.kill()
        there.process.wait()
        took_s = walks_until_it_fails(platform, "the robot is gone|no odometry|nobody subscribes")
        print(f"router gone: latched after {took_s * 1e3:.0f} ms")
        assert took_s < 0.2
        gone_t_ns, why = platform.state().t_ns, platform.state().stopped
    with by_hand(port), platform:
        until(lambda: platform.state().t_ns > gone_t_ns, 8.0)
        assert moved(platform, platform.state().pose) < 0.01
        stays_stopped(platform, why)
        walks_again(platform)


@EXHAUSTIVE
@pytest.mark.parametrize("fault", [Fault.SILENT, Fault.FROZEN_ODOMETRY])
def test_a_robot_that_tells_nothing_new_is_stopped(fault):
    with simulator() as (_, profile), connected(profile) as platform:
        platform.engage()
        send_for(platform, WALK, 0.5)
        goes_wrong(profile, fault)
        took_s = walks_until_it_fails(platform, "no odometry")
        print(f"{fault}: latched after {took_s * 1e3:.0f} ms")
        assert took_s < 0.3 + 0.2  # the odometry's time-out, and the word's way to the robot
        goes_wrong(profile, Fault.NONE)
        stays_stopped(platform, "no odometry")
        walks_again(platform)


def test_a_robot_whose_odometry_begins_again_is_stopped_at_once_and_not_for_want_of_it():
    """Its driver's clock is set back by ten seconds, or the driver is started anew."""
    with simulator() as (_, profile), connected(profile) as platform:
        connection = profile.connection
        with dial(connection.endpoint) as session:
            keys = Keys(connection)
            before = Publisher(session, keys.odometry, attaches=keys.attaches)
            until(lambda: before.matched)  # else nobody hears the only message
            platform.engage()
            send_for(platform, WALK, 0.5)
            ahead_ns = time.time_ns() + 10 * 10**9
            pose, velocity = platform.state().pose, platform.state().velocity
            before.put(encode_odometry(Odometry(pose, velocity, ahead_ns)), ahead_ns)
            took_s = walks_until_it_fails(platform, "time stamps went back")
        print(f"odometry begun again: latched after {took_s * 1e3:.0f} ms")
        assert took_s < 0.3
        stays_stopped(platform, "time stamps went back")
        walks_again(platform)
