"""A simulated robot in another process, and nodes of the test's own."""

import contextlib
import dataclasses
import time

from adatracker_deploy.core.clock import MonotonicClock
from adatracker_deploy.platform import Scenario
from adatracker_deploy.registry import load_profile
from adatracker_ros2.platform import Ros2Platform
from adatracker_ros2.protocol.connection import Qos
from adatracker_ros2.protocol.messages import TYPES
from adatracker_ros2.protocol.participant import Participant
from adatracker_ros2.protocol.qos import ros_qos
from tests.driving import PERIOD_NS

PATIENCE_S = 20.0
ODOMETRY_S = 1.0
"""The odometry's time-out: beside other tests, on two cores, a simulator may not have its turn for 0.3 s."""


def rehearsed(**connection):
    """The shipped profile, patient, with some of its connection changed and a camera that draws seldom."""
    profile = load_profile("ros2_robot", Ros2Platform)
    profile = dataclasses.replace(profile, camera=dataclasses.replace(profile.camera, rate_hz=2.0))
    return changed(profile, **{"odometry_timeout_s": ODOMETRY_S, **connection})


def changed(profile, **connection):
    return dataclasses.replace(profile, connection=dataclasses.replace(profile.connection, **connection))


@contextlib.contextmanager
def simulator(profile):
    """A simulated robot of its own; gives its `Sitl` and the profile that reaches it."""
    with Ros2Platform.sitl(profile) as sitl:
        yield sitl, sitl.start(MonotonicClock(), Scenario(seed=1, width_px=160))


@contextlib.contextmanager
def adapter(profile):
    with Ros2Platform(profile, MonotonicClock()) as platform:
        yield platform


@contextlib.contextmanager
def node(connection, name):
    """A node of the test's own in the robot's domain, on this machine only."""
    participant = Participant(connection, name)
    try:
        yield participant
    finally:
        participant.close()


@contextlib.contextmanager
def publisher(connection, name, topic, type_name, **qos):
    with node(connection, name) as participant:
        made = participant.node.create_publisher(TYPES[type_name], topic, ros_qos(Qos(**qos)))
        participant.start()
        yield made


@contextlib.contextmanager
def listener(connection, name, topic, type_name):
    """A node that hears a topic; gives the list of what has come."""
    heard = []
    with node(connection, name) as participant:
        lossless = ros_qos(Qos(reliability="reliable", depth=100))
        participant.node.create_subscription(TYPES[type_name], topic, heard.append, lossless)
        participant.start()
        yield heard


def send_while(platform, command, wanted):
    """Send at 50 Hz, as the link does, while a condition holds; fail where that lasts too long."""
    clock, give_up_s = platform.clock, time.monotonic() + PATIENCE_S
    due_ns = clock.now_ns()
    while wanted():
        assert time.monotonic() < give_up_s
        platform.send(command, clock.now_ns())
        due_ns = max(due_ns + PERIOD_NS, clock.now_ns())
        clock.sleep_until(due_ns)


def until(condition, why="waited in vain"):
    give_up_s = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < give_up_s, why
        time.sleep(0.01)
