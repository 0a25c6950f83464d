"""The adapter on a robot that fails: it stops, says why, and stays stopped until an explicit engage."""

import contextlib
import math
import time

import pytest

pytest.importorskip("rclpy", reason="ROS 2 is not installed: pip install 'adatracker-deploy[ros2]'")

from adatracker_deploy.core.errors import PlatformError
from adatracker_deploy.core.messages import Twist
from adatracker_ros2.platform import Ros2Platform
from adatracker_ros2.protocol.messages import Odometry, write_battery, write_odometry
from adatracker_ros2.protocol.topics import BATTERY_STATE, ODOMETRY, TWIST, Topics
from tests.driving import Sleepy, engages
from tests.ros2.rehearsal import (
    ODOMETRY_S,
    PATIENCE_S,
    adapter,
    changed,
    listener,
    publisher,
    rehearsed,
    send_while,
    simulator,
    until,
)

pytestmark = pytest.mark.slow

CRUISE, TURN = Twist(vx=0.5), Twist(yaw_rate=1.0)
WORD_S = 0.2
"""The way of a word to the robot."""


@pytest.fixture(scope="module")
def simulated():
    with simulator(rehearsed(odometry_velocity="odom")) as made:
        yield made


def drive_until_refused(platform, why):
    """Send until it is refused; return after how many seconds."""
    begun_s = time.monotonic()
    with pytest.raises(PlatformError, match=why):
        send_while(platform, CRUISE, lambda: True)
    return time.monotonic() - begun_s


def stays_stopped_until_engaged(platform, why):
    until(lambda: abs(platform.state().velocity.vx) < 0.01, "the robot never stood")
    with pytest.raises(PlatformError, match=f"not engaged: .*{why}"):
        platform.send(CRUISE, platform.clock.now_ns())
    until(lambda: engages(platform))
    send_while(platform, CRUISE, lambda: platform.state().velocity.vx < 0.3)


@pytest.mark.parametrize("fault", ["frozen_odometry", "robot_silent"])
def test_a_robot_that_tells_nothing_new_is_stopped(simulated, fault):
    sitl, profile = simulated
    with adapter(profile) as platform:
        platform.connect()
        platform.engage()
        send_while(platform, CRUISE, lambda: platform.state().velocity.vx < 0.3)
        sitl.order(f"begin {fault}")
        try:
            assert drive_until_refused(platform, "no odometry") < ODOMETRY_S + WORD_S
        finally:
            sitl.order(f"end {fault}")
        stays_stopped_until_engaged(platform, "no odometry")


def test_odometry_whose_stamps_go_back_stops_the_robot_at_once(simulated):
    """Its driver's clock was set back by ten seconds, or there are two drivers."""
    _, profile = simulated
    topic = Topics(profile.connection).odometry
    with (
        adapter(profile) as platform,
        publisher(profile.connection, "driver", topic, ODOMETRY, reliability="reliable") as ahead,
    ):
        until(lambda: ahead.get_subscription_count() == 0)
        platform.connect()
        until(lambda: ahead.get_subscription_count() == 1)
        platform.engage()
        send_while(platform, CRUISE, lambda: platform.state().velocity.vx < 0.3)
        now = platform.state()
        ahead.publish(write_odometry(Odometry(now.pose, now.velocity, time.time_ns() + 10 * 10**9)))
        assert drive_until_refused(platform, "time stamps went back") < ODOMETRY_S / 2
        stays_stopped_until_engaged(platform, "time stamps went back")


@contextlib.contextmanager
def told_its_charge(profile, timeout_s):
    """Give a platform and how to tell it a charge until it knows: before both have met, it is lost."""
    profile = changed(profile, battery_topic="bms", battery_timeout_s=timeout_s)
    topic = Topics(profile.connection).battery
    with (
        adapter(profile) as platform,
        publisher(profile.connection, "bms", topic, BATTERY_STATE, reliability="reliable") as bms,
    ):

        def tell(charge, known):
            def knows():
                bms.publish(write_battery(charge))
                return platform.state().battery == known

            until(knows, f"was told {charge}, and did not know {known}")

        platform.connect()
        assert platform.state().battery is None
        yield platform, tell


def test_a_charge_that_is_told_as_unknown_is_not_kept(simulated):
    """The gate stops a robot that has told its charge and does not any more."""
    _, profile = simulated
    with told_its_charge(profile, timeout_s=10 * PATIENCE_S) as (_, tell):
        tell(0.5, 0.5)
        tell(math.nan, None)
        tell(0.4, pytest.approx(0.4))


@pytest.mark.parametrize("after", ["silence", "what cannot be"])
def test_a_charge_that_is_told_no_more_is_not_kept(simulated, after):
    _, profile = simulated
    with told_its_charge(profile, timeout_s=1.0) as (platform, tell):
        tell(0.5, 0.5)
        if after == "silence":
            until(lambda: platform.state().battery is None)
        else:
            tell(80.0, None)


def test_after_a_suspend_no_moving_command_leaves_and_a_stop_has_latched(simulated, monkeypatch):
    _, profile = simulated
    topic = Topics(profile.connection).command
    with (
        Ros2Platform(profile, Sleepy()) as platform,
        listener(profile.connection, "listener", topic, TWIST) as heard,
    ):
        platform.connect()
        platform.engage()
        send_while(platform, CRUISE, lambda: platform.state().velocity.vx < 0.3 or not heard)
        until(lambda: heard[-1].linear.x == CRUISE.vx)
        heard.clear()
        monkeypatch.setattr(Sleepy, "asleep_ns", 3_000_000_000)
        for _ in range(3):
            with pytest.raises(PlatformError, match=r"the machine was suspended for 3\.0 s"):
                platform.send(CRUISE, platform.clock.now_ns())
        until(lambda: heard)
        platform.disengage()
        assert {message.linear.x for message in heard} == {0.0}


def test_a_robot_that_has_turned_round_measures_its_velocity_ahead(simulated):
    """Its odometry tells the velocity in its own axes, which the fence must not take for the body's."""
    _, profile = simulated
    with adapter(profile) as platform:
        platform.connect()
        platform.engage()
        send_while(platform, TURN, lambda: math.cos(platform.state().pose.yaw) > -0.7)
        send_while(platform, CRUISE, lambda: math.hypot(*ahead(platform)) < 0.3)
        forth, left = ahead(platform)
        assert forth > 0.25
        assert abs(left) < 0.1


def ahead(platform):
    velocity = platform.state().velocity
    return velocity.vx, velocity.vy
