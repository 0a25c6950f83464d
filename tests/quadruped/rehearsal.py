"""A simulated robot and an adapter that drives it, for tests of what happens between them."""

import contextlib
import dataclasses
import math
from pathlib import Path

from adatracker_deploy.core.clock import MonotonicClock
from adatracker_deploy.platform import Scenario
from adatracker_deploy.registry import load_profile
from adatracker_quadruped.platform import QuadrupedPlatform
from adatracker_quadruped.protocol.rehearsal_keys import SitlKeys
from adatracker_quadruped.protocol.session import open_session
from tests.by_hand import simulator_by_hand
from tests.quadruped.routers import publisher_of, until


def rehearsed(**connection):
    """The shipped profile with some of its connection changed."""
    profile = load_profile("go2", QuadrupedPlatform)
    return dataclasses.replace(profile, connection=dataclasses.replace(profile.connection, **connection))


@contextlib.contextmanager
def simulator(profile=None):
    """A simulated robot of its own; gives its `Sitl` and the profile that reaches it."""
    with QuadrupedPlatform.sitl(profile or rehearsed()) as sitl:
        yield sitl, sitl.start(MonotonicClock(), Scenario(seed=1))


@contextlib.contextmanager
def connected(profile):
    """An adapter that has passed its preflight."""
    with QuadrupedPlatform(profile, MonotonicClock()) as platform:
        platform.connect()
        assert [check for check in platform.preflight() if check.blocking and not check.ok] == []
        yield platform


def goes_wrong(profile, fault):
    """Tell the simulated robot what is wrong with it, or that nothing is any more."""
    with open_session(profile.connection) as session:
        tell(session, SitlKeys(profile.connection).fault, str(fault).encode())


def tell(session, key, payload):
    """Publish the payload once there is a subscriber."""
    publisher = publisher_of(session, key)
    until(lambda: publisher.matching_status.matching)
    publisher.put(payload)


def speed(platform):
    """Return the speed in the robot's odometry, m/s."""
    velocity = platform.state().velocity
    return math.hypot(velocity.vx, velocity.vy)


def moved(platform, since, seconds=1.0):
    """Wait `seconds`; return the robot's distance from the pose `since`, m."""
    platform.clock.sleep_until(platform.clock.now_ns() + round(seconds * 1e9))
    pose = platform.state().pose
    return since.distance_to(pose.x, pose.y)


def by_hand(port):
    """The simulator's process as an engineer starts it."""
    return simulator_by_hand("adatracker_quadruped.sim.sitl", "--listen", f"tcp/127.0.0.1:{port}")


def memory_kb(pid):
    status = Path(f"/proc/{pid}/status").read_text(encoding="ascii")
    return next(int(line.split()[1]) for line in status.splitlines() if line.startswith("VmRSS"))
