"""The conformance suite is itself tested: a robot that breaks one promise fails the test of that promise."""

import dataclasses
import math

import pytest

from adatracker_deploy.errors import PlatformError
from adatracker_deploy.platform import ZERO, Check, Twist
from adatracker_deploy.runtime.clock import MonotonicClock
from adatracker_deploy.testing.conformance import STOPS, PlatformConformance
from adatracker_deploy.testing.fake import FakeConnection, FakePlatform, fake_profile
from adatracker_deploy.world.bodies import KinematicBody


class MovesBeforeEngage(FakePlatform):
    def preflight(self):
        self._engaged = True
        return super().preflight()


class AcceptsNan(FakePlatform):
    def send(self, command, now_ns):
        return super().send(command if command.is_finite() else ZERO, now_ns)


class KeepsQuietAboutWhatItDropped(FakePlatform):
    def send(self, command, now_ns):
        super().send(command, now_ns)
        return command


class TurnsTheOtherWay(FakePlatform):
    def send(self, command, now_ns):
        return super().send(dataclasses.replace(command, yaw_rate=-command.yaw_rate), now_ns)


class ForgetsItsStop(FakePlatform):
    def send(self, command, now_ns):
        self._engaged = math.isfinite(command.vx)
        return super().send(command, now_ns)


class NeverTimesOut(FakePlatform):
    def _catch_up(self):
        self._sent_ns = self.clock.now_ns()
        super()._catch_up()


class EngagesThroughAStop(FakePlatform):
    def engage(self):
        try:
            super().engage()
        finally:
            self._engaged = True


class BlocksInState(FakePlatform):
    def state(self):
        self.clock.sleep_until(self.clock.now_ns() + 100_000_000)
        return super().state()


class FailsItsPreflight(FakePlatform):
    def preflight(self):
        return (Check("time-out", ok=False, message="it is switched off"),)


class CannotBeStoppedTwice(FakePlatform):
    def disengage(self):
        if not self._connected:
            raise PlatformError("already gone")
        super().disengage()
        self._connected = False


class RemembersItsPast(FakePlatform):
    @classmethod
    def body(cls, profile):
        class Worn(KinematicBody):
            steps = 0

            def step(self, command: Twist, dt_s: float) -> None:
                self.steps += 1
                super().step(command, dt_s * (1 + 1e-9 * self.steps))

        return Worn(profile.sitl)


PROFILE = fake_profile(FakeConnection(engage_s=1.0))
suite = PlatformConformance()
suite.patience_s = 1.0


def connected(mutant):
    suite.platform_class = mutant
    return mutant(PROFILE, MonotonicClock(speed=10.0))


def engaged(mutant):
    platform = connected(mutant)
    platform.connect()
    platform.engage()
    return platform


@pytest.mark.parametrize(
    ("mutant", "promise", "begin"),
    [
        (MovesBeforeEngage, "test_nothing_moves_before_engage", connected),
        (FailsItsPreflight, "test_the_preflight_passes_and_explains_itself", connected),
        (AcceptsNan, "test_a_command_that_is_not_finite_is_refused_and_moves_nothing", engaged),
        (KeepsQuietAboutWhatItDropped, "test_send_returns_what_was_sent", engaged),
        (TurnsTheOtherWay, "test_commands_are_followed_in_the_frame_of_rep_103", engaged),
        (ForgetsItsStop, "test_hold_latches_until_an_explicit_engage", engaged),
        (NeverTimesOut, "test_a_silent_sender_is_stopped_by_the_robots_own_time_out", engaged),
        (BlocksInState, "test_state_never_blocks_and_tells_its_age", engaged),
        (CannotBeStoppedTwice, "test_an_engaged_robot_can_be_stopped_in_any_order_and_twice", engaged),
    ],
    ids=lambda value: getattr(value, "__name__", ""),
)
def test_a_robot_that_breaks_a_promise_fails_its_test(mutant, promise, begin):
    arguments = [("disengage", "hold", "close")] if "any_order" in promise else []
    with pytest.raises((AssertionError, PlatformError, pytest.fail.Exception)):
        getattr(suite, promise)(begin(mutant), *arguments)


def test_a_robot_that_engages_through_a_stop_fails():
    for stop in STOPS:
        with pytest.raises((AssertionError, pytest.fail.Exception)):
            suite.test_a_stop_from_another_thread_ends_an_engage(connected(EngagesThroughAStop), stop)


def test_a_body_that_its_past_changes_fails():
    connected(RemembersItsPast)
    with pytest.raises(AssertionError):
        suite.test_the_body_is_deterministic_by_seed(PROFILE)
