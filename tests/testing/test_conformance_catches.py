"""The conformance suite is itself tested: a robot that breaks one promise fails the test of that promise."""

import contextlib
import dataclasses
import math
import threading
from typing import ClassVar

import pytest

from adatracker_deploy.core.clock import MonotonicClock
from adatracker_deploy.core.errors import PlatformError
from adatracker_deploy.core.messages import ZERO, Twist
from adatracker_deploy.platform import Check, Scenario
from adatracker_deploy.sim.bodies import KinematicBody
from adatracker_deploy.testing import fake
from adatracker_deploy.testing.conformance import STOPS, PlatformConformance
from adatracker_deploy.testing.fake import FakeConnection, FakePlatform, FakeSimulator, fake_profile
from tests.tiers import EXHAUSTIVE

pytestmark = pytest.mark.slow


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


class HoldsItsLockWhileItSends(FakePlatform):
    def send(self, command, now_ns):
        with self._lock:
            threading.Event().wait(0.031)
            return super().send(command, now_ns)


class IgnoresSilence(FakePlatform):
    def _unheard_s(self):
        return 0.0


class DrivesOnWhenItIsHeardAgain(FakePlatform):
    def send(self, command, now_ns):
        self._catch_up()
        if self._engaged and self._unheard_s() > 0.3:
            raise PlatformError("the robot is not heard just now")
        return super().send(command, now_ns)


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
        pytest.param(
            HoldsItsLockWhileItSends, "test_state_never_blocks_and_tells_its_age", engaged, marks=EXHAUSTIVE
        ),
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


@pytest.mark.parametrize("mutant", [IgnoresSilence, DrivesOnWhenItIsHeardAgain])
def test_a_robot_that_drives_on_through_or_after_silence_fails(mutant):
    promise = suite.test_a_robot_that_fell_silent_and_is_heard_again_stays_stopped
    for fit, robot in ((True, FakePlatform), (False, mutant)):
        suite.platform_class = robot
        sitl = robot.sitl(PROFILE)
        platform = robot(sitl.start(MonotonicClock(speed=10.0), Scenario()), MonotonicClock(speed=10.0))
        platform.connect()
        platform.engage()
        with contextlib.nullcontext() if fit else pytest.raises((AssertionError, pytest.fail.Exception)):
            promise(sitl, platform)


def test_a_simulator_that_cannot_be_silent_is_told_what_to_do(monkeypatch):
    monkeypatch.setattr(FakeSimulator, "faults", ())
    with pytest.raises(AssertionError, match="let the simulator obey robot_silent"):
        suite.test_a_robot_that_fell_silent_and_is_heard_again_stays_stopped(
            FakePlatform.sitl(PROFILE), engaged(FakePlatform)
        )


class AgainstTheManual(PlatformConformance):
    platform_class = FakePlatform
    manual: ClassVar = {
        Twist(vx=0.5): "000000000000e03f" + "00" * 8,
        Twist(yaw_rate=0.25): "00" * 8 + "000000000000d03f",
    }
    says = "adatracker_deploy.testing.fake:to_wire"


@pytest.mark.parametrize("wrong", ["yaw_rate", "vx"])
def test_a_sign_that_is_wrong_on_both_sides_of_the_wire_fails(monkeypatch, wrong):
    def turned(command):
        return dataclasses.replace(command, **{wrong: -getattr(command, wrong)})

    promise = AgainstTheManual().test_the_bytes_on_the_wire_are_those_of_the_manual
    promise(engaged(FakePlatform))
    to_wire, from_wire = fake.to_wire, fake.from_wire
    monkeypatch.setattr(fake, "to_wire", lambda command: to_wire(turned(command)))
    monkeypatch.setattr(fake, "from_wire", lambda payload: turned(from_wire(payload)))
    suite.test_commands_are_followed_in_the_frame_of_rep_103(engaged(FakePlatform))  # which does not see it
    with pytest.raises(AssertionError, match="never went out as"):
        promise(engaged(FakePlatform))


def test_a_robot_without_a_page_of_its_manual_fails():
    with pytest.raises(AssertionError, match="vendor's manual"):
        suite.test_the_bytes_on_the_wire_are_those_of_the_manual(engaged(FakePlatform))


def test_a_body_that_its_past_changes_fails():
    connected(RemembersItsPast)
    with pytest.raises(AssertionError):
        suite.test_the_body_is_deterministic_by_seed(PROFILE)
