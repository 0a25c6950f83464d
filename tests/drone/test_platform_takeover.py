"""A drone that its pilot has taken: whatever is asked for afterwards, nothing is ordered any more."""

import dataclasses
import itertools
import threading
import time

import pytest
from watched import Watched, until, watched

from adatracker_deploy.core.clock import MonotonicClock
from adatracker_deploy.core.errors import PlatformError
from adatracker_deploy.core.messages import Twist
from adatracker_drone.adapter.command_client import CommandClient
from adatracker_drone.adapter.commands import ARM
from adatracker_drone.platform import DronePlatform
from adatracker_drone.protocol.px4 import Mode
from tests.race import owners, race
from tests.tiers import EXHAUSTIVE, sampled

pytestmark = pytest.mark.slow

PILOTS = (Mode.HOLD, Mode.POSCTL, Mode.RTL)
MOMENTS_S = (0.0, 0.02, 0.05, 0.1, 0.15, 0.3)
"""From the pilot's change of mode to a Ctrl-C."""
FEW = 8
"""Set-points at 50 Hz until the new mode is known."""


def drive(platform, seconds):
    """Send at 50 Hz, as the link does; end without a word when it is refused."""
    end_s = time.monotonic() + seconds
    while time.monotonic() < end_s:
        try:
            platform.send(Twist(vx=0.5), platform.clock.now_ns())
        except PlatformError:
            return
        time.sleep(0.02)


def take_over_and_stop(drone, platform, mode, after_s):
    """Let the pilot switch in flight, and stop so much later from another thread, as the link does."""
    platform.engage()
    drive(platform, 0.3)
    driving = threading.Thread(target=drive, args=(platform, 2.0))
    driving.start()
    time.sleep(0.1)
    switched_s = drone.pilot(mode)
    time.sleep(max(0.0, switched_s + after_s - time.monotonic()))
    platform.hold("Ctrl-C")
    platform.disengage()
    driving.join()
    return switched_s


@EXHAUSTIVE
def test_a_pilot_is_never_overridden_whenever_the_stop_comes(measured, exhaustive):
    cases = list(itertools.product(PILOTS, MOMENTS_S))
    if not exhaustive:  # each mode once, each at another moment
        cases = list(zip(PILOTS, MOMENTS_S[::2], strict=True))
    most, wrong = 0, []
    with watched(parameters={"COM_OBL_RC_ACT": 4.0, "RTL_RETURN_ALT": 3.0}) as (drone, platform):
        for mode, after_s in cases:
            switched_s = take_over_and_stop(drone, platform, mode, after_s)
            time.sleep(0.2)
            told = [each.order for each in drone.since(switched_s)]
            most = max(most, told.count("MOVE"))
            if set(told) - {"MOVE", "ZERO"} or told.count("MOVE") > FEW:
                wrong.append((mode.name, after_s, told))
            assert platform.state().taken_over, (mode, after_s)
            drone.pilot(Mode.HOLD)
            until(lambda: platform.state().mode == "HOLD")
    measured(f"drone, pilot's change and a stop 0 to 0.3 s later: {most} moving set-points at most")
    assert not wrong


@EXHAUSTIVE
@pytest.mark.parametrize("after_s", [0.02, pytest.param(0.15, marks=EXHAUSTIVE)])
def test_an_older_autopilots_pilot_is_not_overridden_either(after_s):
    with watched(tells_current_mode=False) as (drone, platform):
        (takeover,) = [check for check in platform.preflight() if check.name == "takeover"]
        assert not takeover.ok
        switched_s = take_over_and_stop(drone, platform, Mode.POSCTL, after_s)
        assert not {told.order for told in drone.since(switched_s)} - {"MOVE", "ZERO"}
        assert drone.mode is Mode.POSCTL


ENGAGING = {
    "ramping up": lambda drone: not drone.autopilot.commander.landed,
    "climbing": lambda drone: drone.motion.altitude > 0.5,
}


@pytest.mark.parametrize(
    ("mode", "phase"),
    sampled(
        itertools.product((Mode.HOLD, Mode.POSCTL, Mode.RTL), ("ramping up", "climbing")),
        everyday=((Mode.HOLD, "climbing"), (Mode.POSCTL, "ramping up")),
    ),
)
def test_a_pilot_who_takes_it_while_it_engages_has_it(phase, mode):
    with watched(speed=2.0) as (drone, platform):
        refused = []

        def engage():
            try:
                platform.engage()
            except PlatformError as error:
                refused.append(str(error))

        engaging = threading.Thread(target=engage)
        engaging.start()
        until(lambda: ENGAGING[phase](drone))
        switched_s = drone.pilot(mode)
        time.sleep(0.1)
        platform.disengage()
        engaging.join(10.0)
        assert not engaging.is_alive()
        assert not {told.order for told in drone.since(switched_s)} - {"ZERO"}
        assert platform.state().taken_over
        assert len(drone.since(switched_s + 0.3)) == 0


@EXHAUSTIVE
def test_a_pilot_who_takes_it_once_it_is_armed_is_not_overridden_by_the_take_off(monkeypatch):
    """The switch falls between the answer to ARM and the next command, before any report of the new mode."""
    order = CommandClient.order
    with watched() as (drone, platform):

        def order_and_lose(self, command, *modes):
            order(self, command, *modes)
            if command == ARM:
                drone.pilot(Mode.POSCTL)

        monkeypatch.setattr(CommandClient, "order", order_and_lose)
        with pytest.raises(PlatformError, match="went to POSCTL by its pilot"):
            platform.engage()
        platform.disengage()
        assert not {told.order for told in drone.since(0.0)} & {"TAKEOFF", "LAND"}
        assert drone.mode is Mode.POSCTL


@EXHAUSTIVE
def test_a_pilot_who_stops_our_landing_has_it():
    with watched(speed=2.0) as (drone, platform):
        platform.engage()
        landing = threading.Thread(target=platform.disengage)
        landing.start()
        until(lambda: drone.mode is Mode.LAND and drone.motion.v_down > 0.3)
        switched_s = drone.pilot(Mode.POSCTL)
        landing.join(10.0)
        assert not landing.is_alive()
        assert drone.since(switched_s) == []
        assert drone.mode is Mode.POSCTL


@EXHAUSTIVE
def test_one_that_does_not_tell_whose_it_is_is_left_alone():
    """Its answers are lost: it is not told to land, for a pilot may have it; its own fail-safe lands it."""
    with watched() as (drone, platform):
        platform.engage()
        drive(platform, 0.3)
        drone._orders.handle("begin robot_silent")
        drone._send = lambda messages: None
        stopped_s = time.monotonic()
        with pytest.raises(PlatformError, match="nobody knows who controls the drone"):
            platform.disengage()
        assert not {told.order for told in drone.since(stopped_s)} - {"ZERO", "MOVE"}
        until(lambda: drone.autopilot.at_rest)


def test_a_drone_that_has_an_owner_is_nobody_elses():
    with watched() as (_, platform):
        refused = []

        def start():
            other = DronePlatform(platform.profile, MonotonicClock())
            try:
                other.connect()
            except PlatformError as error:
                refused.append(str(error))

        for _ in range(10):
            threads = [threading.Thread(target=start) for _ in range(2)]
            for thread in threads:
                thread.start()
            for thread in threads:
                thread.join()
        assert len(refused) == 20
        assert "is driven by another program on this machine" in refused[0]
        assert platform.preflight()


def test_of_two_that_start_at_once_exactly_one_has_the_drone(measured, exhaustive):
    from test_platform_sitl import rehearsal_profile

    profile = rehearsal_profile()
    drone = Watched(profile, MonotonicClock())
    try:
        results = race(
            "drone",
            dataclasses.asdict(profile.connection),
            "--connect-only",
            starts=50 if exhaustive else 5,
        )
    finally:
        drone.close()
    counts = [len(owners(result)) for result in results]
    measured(f"two starts at once for a drone: {counts.count(1)} of {len(counts)} with one owner")
    assert counts == [1] * len(results), results
    refused = [said for result in results for said in result if said != "owner"]
    assert all("another program on this machine" in said for said in refused)
