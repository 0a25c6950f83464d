"""The simulated robot stops by itself in time when its host fails; the tests print how soon."""

import contextlib
import math
import os
import signal
import subprocess
import sys
import time

import pytest

from adatracker_deploy.core.clock import MonotonicClock
from adatracker_deploy.core.messages import Twist
from adatracker_quadruped.adapter.command_publisher import Commander
from adatracker_quadruped.adapter.subscriber import Subscriber
from adatracker_quadruped.protocol.cdr import SMALL_CAP_BYTES
from adatracker_quadruped.protocol.messages import decode_odometry
from adatracker_quadruped.protocol.session import open_session
from tests.quadruped.rehearsal import simulator
from tests.quadruped.routers import until
from tests.tiers import EXHAUSTIVE

pytestmark = pytest.mark.slow

STANDING_M_S = 0.01


@contextlib.contextmanager
def driver(profile, ending):
    """A host in a process of its own, whose robot walks at 1 m/s."""
    process = subprocess.Popen(
        [sys.executable, "-m", "tests.quadruped.driver", profile.connection.endpoint, ending],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        assert process.stdout.readline() == "walking\n", process.stderr.read()
        yield process
    finally:
        process.send_signal(signal.SIGCONT)
        process.kill()
        process.wait()
        process.stdout.close()
        process.stderr.close()


class Onlooker:
    """A second subscriber to the robot's odometry, beside its host."""

    def __init__(self, session):
        self._tap = Subscriber(session, "odom", decode_odometry, MonotonicClock(), SMALL_CAP_BYTES)
        until(lambda: self._tap.newest is not None)

    @property
    def pose(self):
        return self._tap.newest.value.pose

    @property
    def speed(self):
        velocity = self._tap.newest.value.velocity
        return math.hypot(velocity.vx, velocity.vy)

    def stands_after(self, begin_s):
        """Wait until the robot stands; return the seconds since `begin_s`."""
        until(lambda: self.speed < STANDING_M_S)
        return time.monotonic() - begin_s


@pytest.mark.parametrize(
    ("ending", "end", "begins_m_s", "within_s"),
    [
        pytest.param("raise", None, None, 1.3, marks=EXHAUSTIVE),
        pytest.param("forget", None, None, 1.3, marks=EXHAUSTIVE),
        pytest.param("drive", signal.SIGINT, 0.9, 1.3, marks=EXHAUSTIVE),
        pytest.param("drive", signal.SIGTERM, 0.9, 1.3, marks=EXHAUSTIVE),
        ("drive", signal.SIGKILL, 0.9, 1.3),
        ("drive", signal.SIGSTOP, 0.9, 0.5 + 1.3),
    ],
    ids=["exception", "end without a close", "Ctrl-C", "SIGTERM", "kill -9", "SIGSTOP"],
)
def test_a_host_that_ends_in_whatever_way_leaves_a_standing_robot(ending, end, begins_m_s, within_s):
    with simulator() as (_, profile), open_session(profile.connection) as session:
        onlooker = Onlooker(session)
        with driver(profile, ending) as process:
            if end is not None:
                until(lambda: onlooker.speed > begins_m_s)
                process.send_signal(end)
            begin_s, start = time.monotonic(), onlooker.pose
            until(lambda: onlooker.speed < 0.5)
            slowed_s = time.monotonic() - begin_s
            took_s = onlooker.stands_after(begin_s)
            went_m = start.distance_to(onlooker.pose.x, onlooker.pose.y)
            print(
                f"{end.name if end else ending}: half as fast after {slowed_s:.2f} s, stood after "
                f"{took_s:.2f} s and {went_m:.2f} m"
            )
            assert took_s < within_s
            if end is not signal.SIGSTOP:
                assert process.wait(3.0) == {"raise": 1, "forget": 0}.get(ending, -(end or 0))


@EXHAUSTIVE
def test_a_frozen_hosts_backlog_moves_nothing():
    with simulator() as (_, profile), open_session(profile.connection) as session:
        onlooker = Onlooker(session)
        with driver(profile, "drive") as process:
            until(lambda: onlooker.speed > 0.9)
            process.send_signal(signal.SIGSTOP)
            onlooker.stands_after(time.monotonic())
            clock = MonotonicClock()
            clock.sleep_until(clock.now_ns() + 1_500_000_000)  # longer than the lease
            start = onlooker.pose
            process.send_signal(signal.SIGCONT)
            assert process.wait(8.0) != 0  # its own watch found that the odometry was old
            onlooker.stands_after(time.monotonic())
            print(f"host thawed: went {start.distance_to(onlooker.pose.x, onlooker.pose.y):.2f} m")


@EXHAUSTIVE
def test_a_thawed_robots_backlog_moves_nothing():
    with simulator() as (sitl, profile), open_session(profile.connection) as session:
        onlooker, clock = Onlooker(session), MonotonicClock()
        commander = Commander(session, profile.connection)
        until(lambda: commander.matched)
        start = onlooker.pose
        os.kill(sitl.pid, signal.SIGSTOP)
        for _ in range(30):  # for less than the lease, so that the link holds
            commander.walk(Twist(vx=1.0), time.time_ns())
            clock.sleep_until(clock.now_ns() + 20_000_000)
        os.kill(sitl.pid, signal.SIGCONT)
        clock.sleep_until(clock.now_ns() + 1_000_000_000)
        assert start.distance_to(onlooker.pose.x, onlooker.pose.y) == 0.0

        def walking():
            commander.walk(Twist(vx=1.0), time.time_ns())
            return onlooker.speed > 0.5

        until(walking)  # it was not deaf for good
