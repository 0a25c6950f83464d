"""A stop at any moment of an engagement, a suspended machine, and Spot: nothing walks on by itself."""

import contextlib
import dataclasses
import math
import threading

import pytest

from adatracker_deploy.core.clock import MonotonicClock
from adatracker_deploy.core.errors import PlatformError
from adatracker_deploy.core.geometry import Pose
from adatracker_deploy.core.messages import ZERO, Twist
from adatracker_deploy.platform import Scenario
from adatracker_deploy.registry import load_profile
from adatracker_quadruped.adapter.lease import Lease
from adatracker_quadruped.platform import QuadrupedPlatform
from adatracker_quadruped.protocol.messages import Odometry, encode_odometry, in_body, in_odom
from tests.driving import Engaging, Sleepy, send_for
from tests.quadruped.rehearsal import connected, simulator, speed
from tests.quadruped.routers import until

WALK = Twist(vx=0.8)
STOPS = {
    "hold": lambda platform: platform.hold("the test says so"),
    "disengage": lambda platform: platform.disengage(),
    "close": lambda platform: platform.close(),
}


@pytest.fixture(scope="module")
def profile():
    with simulator() as (_, reached):
        yield reached


@pytest.mark.slow
@pytest.mark.parametrize("stop", STOPS)
@pytest.mark.parametrize("moment", ["before its turn", "while it claims", "before its last word"])
def test_a_stop_at_any_moment_of_an_engagement_is_the_last_word(profile, stop, moment, monkeypatch):
    with connected(profile) as platform:
        reached, take = threading.Event(), Lease.take

        def taking(lease, given_up):
            if moment == "while it claims":
                lease.release()
            reached.set()
            if moment == "before its last word":
                until(given_up)
                return True
            return take(lease, given_up)

        monkeypatch.setattr(Lease, "take", taking)
        engaging = Engaging(platform)
        stopping = threading.Thread(target=STOPS[stop], args=(platform,))
        if moment == "before its turn":
            with platform._opening:
                engaging.start()
                stopping.start()
                until(lambda: platform._stops)
        else:
            engaging.start()
            reached.wait()
            stopping.start()
        for thread in (engaging, stopping):
            thread.join()
        monkeypatch.undo()
        assert engaging.why
        assert not platform.state().engaged
        with pytest.raises(PlatformError):
            platform.send(WALK, platform.clock.now_ns())


@pytest.mark.slow
def test_after_a_suspend_no_moving_command_leaves_and_a_stop_has_latched(profile, monkeypatch):
    with QuadrupedPlatform(profile, Sleepy()) as platform:
        platform.connect()
        platform.engage()
        send_for(platform, WALK, 0.3)
        made_ns = platform.clock.now_ns()
        monkeypatch.setattr(Sleepy, "asleep_ns", 3_000_000_000)
        sent = []
        commander = platform._wire.commander
        monkeypatch.setattr(commander, "walk", lambda twist, _stamp_ns: sent.append(twist))
        for _ in range(3):
            with pytest.raises(PlatformError, match=r"the machine was suspended for 3\.0 s"):
                platform.send(WALK, made_ns)
        assert sent == [ZERO]
        monkeypatch.undo()
        platform.disengage()


@pytest.fixture(scope="module")
def spot():
    shipped = load_profile("spot", QuadrupedPlatform)
    with QuadrupedPlatform.sitl(shipped) as sitl:
        yield sitl.start(MonotonicClock(), Scenario(seed=1))


@pytest.mark.slow
def test_spot_stops_an_eighth_of_a_second_after_the_last_command_and_is_not_set_going_again(spot):
    assert spot.connection.command_timeout_s == 0.125
    with connected(spot) as platform:
        platform.engage()
        send_for(platform, WALK, 1.0)
        platform.clock.sleep_until(platform.clock.now_ns() + 200_000_000)
        with pytest.raises(PlatformError, match="the robot has stopped by itself"):
            platform.send(WALK, platform.clock.now_ns())
        until(lambda: speed(platform) < 0.05)
        with pytest.raises(PlatformError, match="the robot has stopped by itself"):
            platform.send(WALK, platform.clock.now_ns())


@pytest.mark.slow
def test_spot_that_has_turned_round_measures_its_velocity_ahead(spot):
    with connected(spot) as platform:
        platform.engage()

        def turned():
            with contextlib.suppress(PlatformError):
                send_for(platform, Twist(yaw_rate=1.2), 0.1)
            if not platform.state().engaged:
                platform.engage()
            return abs(abs(platform.state().pose.yaw) - math.pi / 2) < 0.3

        until(turned, 20.0)
        send_for(platform, WALK, 1.5)
        velocity = platform.state().velocity
        assert velocity.vx > 0.4
        assert abs(velocity.vy) < 0.2


@pytest.mark.parametrize("yaw", [0.0, 1.0, math.pi / 2, -2.5])
def test_a_velocity_in_the_odometrys_axes_is_put_right_in_one_place(yaw):
    ahead = Odometry(Pose(yaw=yaw), Twist(vx=1.0, yaw_rate=0.3), 1)
    told = in_odom(ahead)
    assert told.velocity.vx == pytest.approx(math.cos(yaw))
    assert told.velocity.vy == pytest.approx(math.sin(yaw))
    back = in_body(told).velocity
    assert dataclasses.astuple(back) == pytest.approx((1.0, 0.0, 0.0, 0.3))
    assert encode_odometry(told) != encode_odometry(ahead) or yaw == 0.0
