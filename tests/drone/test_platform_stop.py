"""A stop while the drone engages: nothing that climbs follows, and the drone is on its way down at once."""

import contextlib
import threading
import time

import pytest
from watched import until, watched

from adatracker_deploy.core.errors import PlatformError
from adatracker_drone.protocol.px4 import Mode
from tests.tiers import EXHAUSTIVE, sampled

pytestmark = pytest.mark.slow

TOWARDS_FLIGHT = {"ARM", "TAKEOFF", "OFFBOARD", "MOVE", "ZERO"}
UNFINISHED = 0.02
"""s; what was on its way when the stop was called."""

PHASES = {
    "arming": lambda drone: drone.autopilot.commander.armed,
    "ramping up": lambda drone: not drone.autopilot.commander.landed,
    "climbing": lambda drone: drone.motion.altitude > 0.7,
    "holding": lambda drone: drone.mode is Mode.HOLD and drone.motion.altitude > 1.0,
    "switching": lambda drone: "OFFBOARD" in [told.order for told in drone.told],
}


class Engaging(threading.Thread):
    def __init__(self, platform):
        super().__init__()
        self.refused = None
        self._platform = platform
        self.start()

    def run(self):
        try:
            self._platform.engage()
        except PlatformError as error:
            self.refused = error


def stop_and_watch(drone, platform, stop):
    """Stop from this thread; return when it was called, and the highest that the drone got after it."""
    highest_m, falls_s, over = drone.motion.altitude, [], threading.Event()

    def watch():
        nonlocal highest_m
        while not over.wait(0.005):
            highest_m = max(highest_m, drone.motion.altitude)
            if drone.motion.v_down > 0.05:
                falls_s.append(time.monotonic())

    watching = threading.Thread(target=watch)
    watching.start()
    stopped_s = time.monotonic()
    stop(platform)
    over.set()
    watching.join()
    return stopped_s, highest_m, (falls_s[0] - stopped_s) if falls_s else None


@pytest.mark.parametrize(
    "phase",
    sampled(PHASES, everyday=("climbing",)),
)
def test_a_stop_while_engaging_lands_it_and_nothing_that_climbs_follows(phase, measured):
    with watched() as (drone, platform):
        engaging = Engaging(platform)
        until(lambda: PHASES[phase](drone))
        before_m = drone.motion.altitude
        stopped_s, highest_m, falls_s = stop_and_watch(drone, platform, lambda drone: drone.disengage())
        engaging.join(5.0)
        assert not engaging.is_alive()
        assert not [told for told in drone.since(stopped_s + UNFINISHED) if told.order in TOWARDS_FLIGHT]
        first = drone.since(stopped_s, *TOWARDS_FLIGHT)[0]
        assert first.order == "LAND"
        assert first.at_s - stopped_s < 0.3
        assert drone.autopilot.at_rest
        assert highest_m - before_m < 0.6
        assert drone.mode is Mode.HOLD
        told = f"LAND {first.at_s - stopped_s:.2f} s after the stop"
        if before_m > 0.5:
            told += f", {highest_m - before_m:.2f} m higher, down from {falls_s:.2f} s on"
        else:
            assert highest_m < 0.1, "it has not left the ground"
        measured(f"drone, stopped while {phase}: {told}")


@EXHAUSTIVE  # and a row of the fault matrix, in its everyday sample
def test_a_stop_while_it_climbs_to_nine_metres_does_the_same(measured):
    band = {"altitude_m": (1.0, 12.0)}
    with watched(speed=2.0, connection={"takeoff_altitude_m": 9.0}, limits=band) as (drone, platform):
        engaging = Engaging(platform)
        until(lambda: drone.motion.altitude > 2.0)
        before_m = drone.motion.altitude
        stopped_s, highest_m, _ = stop_and_watch(drone, platform, lambda drone: drone.disengage())
        engaging.join(5.0)
        assert "OFFBOARD" not in [told.order for told in drone.told]
        assert drone.since(stopped_s, *TOWARDS_FLIGHT)[0].order == "LAND"
        assert highest_m - before_m < 1.0
        assert drone.autopilot.at_rest
        measured(f"drone, stopped while it climbs to 9 m: {highest_m - before_m:.2f} m higher")


@pytest.mark.parametrize(
    ("phase", "order"),
    sampled((("ramping up", "LAND"), ("climbing", "HOLD")), everyday=(("ramping up", "LAND"),)),
)
def test_hold_while_engaging_keeps_it_on_the_ground_or_where_it_is(phase, order):
    with watched(speed=2.0) as (drone, platform):
        engaging = Engaging(platform)
        until(lambda: PHASES[phase](drone))
        if phase == "climbing":
            until(lambda: platform.state().pose.z > 0.7)  # it decides by what it heard, which may be late
        stopped_s = time.monotonic()
        platform.hold("the test says so")
        engaging.join(5.0)
        assert "the test says so" in str(engaging.refused)
        first, *then = [told.order for told in drone.since(stopped_s, *TOWARDS_FLIGHT)]
        assert first == order
        assert then == [] or (order, then) == ("LAND", ["DISARM"])  # refused while the thrust ramps up
        platform.disengage()
        assert drone.autopilot.at_rest
        assert not [told for told in drone.since(stopped_s + UNFINISHED) if told.order in TOWARDS_FLIGHT]


@EXHAUSTIVE
def test_a_landing_is_told_from_a_thrust_that_only_ramps_up():
    with watched(speed=2.0) as (drone, platform):
        engaging = Engaging(platform)
        until(lambda: not drone.autopilot.commander.landed)
        while drone.motion.altitude < 0.05:
            assert platform.state().landed
            time.sleep(0.01)
        until(lambda: not platform.state().landed, 2.0)
        platform.disengage()
        engaging.join(5.0)
        assert platform.state().landed


@EXHAUSTIVE
@pytest.mark.parametrize("found", ["after a stop", "after its own fail-safe"])
def test_it_flies_again_after_every_landing_in_which_px4_goes_back_to_offboard(found):
    with watched(speed=4.0) as (drone, platform):
        platform.engage()
        if found == "after a stop":
            platform.disengage()
            assert drone.mode is Mode.HOLD
        else:
            until(lambda: drone.autopilot.at_rest)  # nobody sends: COM_OBL_RC_ACT lands it
            assert drone.mode is Mode.OFFBOARD
            with contextlib.suppress(PlatformError):
                platform.disengage()
            (mode,) = [check for check in platform.preflight() if check.name == "mode"]
            assert mode.ok
            assert "was put into HOLD" in mode.message
        platform.engage()
        assert platform.state().engaged
        platform.disengage()
        assert drone.autopilot.at_rest
