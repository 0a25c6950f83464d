"""The link drives only while it is told to, and brings the robot to rest whenever it is not."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import ClassVar

import pytest

from adatracker_deploy.core.clock import FakeClock
from adatracker_deploy.core.errors import PlatformError
from adatracker_deploy.core.geometry import Pose
from adatracker_deploy.core.messages import ZERO, Twist
from adatracker_deploy.runtime.gate import Reason, Setpoint
from adatracker_deploy.runtime.link import RATE_HZ, Acted, Link, Phase
from adatracker_deploy.runtime.link_process import wall_timeouts
from adatracker_deploy.testing.fake import FakePlatform, fake_profile

GO = Twist(vx=0.8, yaw_rate=0.2)


class Rig:
    """A link over the fake platform, in lock-step: manoeuvres run inline."""

    def __init__(self, platform_class=FakePlatform) -> None:
        self.clock = FakeClock()
        self.profile = fake_profile()
        self.platform = platform_class(self.profile, self.clock)
        self.platform.connect()
        self.setpoint: Setpoint | None = None
        self.link = Link(
            self.platform, self.profile.limits, self.clock, lambda: self.setpoint, spawn=lambda job: job()
        )

    def step(self, seconds: float, command: Twist | None = None, target_share: float | None = None):
        """Step at the link's rate; with a command, renew it every step."""
        status = self.link.status
        for _ in range(round(seconds * RATE_HZ)):
            self.clock.advance(1 / RATE_HZ)
            now_ns = self.clock.now_ns()
            if command is not None:
                self.setpoint = Setpoint(command, now_ns, target_share)
            status = self.link.step(now_ns)
        return status

    def driving(self) -> Rig:
        self.link.engage()
        assert self.step(2.0, GO).sent == GO
        return self


def test_nothing_is_sent_before_engaging():
    rig = Rig()
    assert rig.step(1.0, GO).phase is Phase.IDLE
    assert rig.platform.sent == []


def test_a_robot_that_is_not_told_to_move_stands_still_and_is_given_up():
    rig = Rig()
    rig.link.engage()
    assert rig.step(0.1).sent == ZERO
    assert rig.step(rig.profile.limits.disengage_after_s).phase is Phase.DONE
    assert all(twist == ZERO for twist in rig.platform.sent)


def test_when_commands_cease_it_sends_zero_then_holds_then_disengages():
    rig, phases = Rig().driving(), []
    limits = rig.profile.limits
    last_ns = rig.setpoint.t_ns
    while not phases or phases[-1][1] is not Phase.DONE:
        status = rig.step(1 / RATE_HZ)
        age_s = (rig.clock.now_ns() - last_ns) / 1e9
        phases.append((age_s, status.phase))
        assert status.sent == ZERO or age_s <= limits.command_timeout_s
    held_s = next(age for age, phase in phases if phase is Phase.HOLDING)
    assert held_s == pytest.approx(limits.hold_after_s, abs=0.03)
    assert phases[-1][0] == pytest.approx(limits.disengage_after_s, abs=0.03)
    assert not rig.platform.state().engaged


def test_commands_that_come_back_after_a_hold_change_nothing():
    rig = Rig().driving()
    assert rig.step(rig.profile.limits.hold_after_s + 0.1).phase is Phase.HOLDING
    count = len(rig.platform.sent)
    assert rig.step(0.5, GO).phase is Phase.HOLDING
    assert len(rig.platform.sent) == count


def test_nan_stops_in_the_same_step_and_never_reaches_the_robot():
    rig = Rig().driving()
    status = rig.step(1 / RATE_HZ, Twist(vx=math.nan))
    assert (status.phase, status.stopped, status.takeover) == (Phase.HOLDING, "not_finite", False)
    assert all(twist.is_finite() for twist in rig.platform.sent)
    assert rig.platform.state().stopped == "not_finite"


def test_a_takeover_is_respected_and_told_apart_from_a_stop_of_ours():
    rig = Rig().driving()
    rig.platform.take_over()
    status = rig.step(0.1, GO)
    assert (status.phase, status.takeover, status.reasons) == (Phase.HOLDING, True, (Reason.TAKEOVER,))
    assert "pilot" in status.stopped
    held = Rig().driving()
    held.link.hold("enough")
    assert not held.step(0.1, GO).takeover
    broken = Rig().driving()
    broken.platform.hold("the motor driver is too hot")  # a stop of the robot's that is nobody's takeover
    status = broken.step(0.1, GO)
    assert (status.phase, status.takeover, status.reasons) == (Phase.HOLDING, False, (Reason.ROBOT_STOPPED,))


def test_a_stop_that_is_asked_for_keeps_its_words():
    rig = Rig().driving()
    rig.link.hold("enough")
    status = rig.step(0.1, GO)
    assert (status.reasons, status.stopped, status.sent) == ((Reason.ASKED,), "enough", ZERO)
    assert {event.level for event in rig.link.drain_events()} == {"info"}
    rig.link.disengage("home")
    assert rig.step(0.1, GO).stopped == "enough"  # the first reason stays
    other = Rig().driving()
    other.link.disengage("home")
    assert (other.link.status.reasons, other.link.status.stopped) == ((Reason.ASKED,), "home")


def test_what_the_gate_changes_is_named_in_the_status():
    rig = Rig().driving()
    assert rig.step(0.1, GO).reasons == ()
    assert rig.step(0.1, Twist(vx=9.0, yaw_rate=GO.yaw_rate)).reasons[0] == Reason.ENVELOPE
    status = rig.step(0.1, GO, target_share=0.6)
    assert (status.reasons[0], status.sent.vx, status.sent.yaw_rate) == (Reason.TOO_CLOSE, 0.0, GO.yaw_rate)


class Telling(FakePlatform):
    """Says of itself what a test wants it to say."""

    says: ClassVar[dict] = {}

    def state(self):
        return replace(super().state(), **self.says)


def test_what_the_robots_wire_has_to_tell_becomes_a_warning_in_every_phase():
    class Noticing(FakePlatform):
        def notices(self):
            return ("a stranger was ignored",)

    rig = Rig(Noticing)
    rig.link.step(rig.clock.now_ns())
    rig.driving()
    told = [event.level for event in rig.link.drain_events() if event.message == "a stranger was ignored"]
    assert len(told) >= 2
    assert set(told) == {"warning"}


def test_the_wires_traffic_is_recorded_and_a_robot_that_cannot_costs_only_that(tmp_path):
    class Recording(FakePlatform):
        def record(self, folder):
            (folder / "traffic").write_text("heard", encoding="ascii")

    rig = Rig(Recording)
    rig.link.record(tmp_path)
    assert (tmp_path / "traffic").read_text(encoding="ascii") == "heard"
    rig.link.record(tmp_path / "missing")
    (event,) = rig.link.drain_events()
    assert event.level == "warning"
    assert "the wire's traffic is not logged: FileNotFoundError" in event.message
    rig.driving()


@pytest.mark.parametrize(
    ("says", "reason", "phase"),
    [
        ({"pose": Pose(x=50.0)}, Reason.POSITION_JUMPED, Phase.HOLDING),
        ({"pose": None}, Reason.POSITION_LOST, Phase.HOLDING),
        ({"battery": None}, Reason.BATTERY_LOST, Phase.HOLDING),
        ({"t_ns": 1}, Reason.STATE_LOST, Phase.HOLDING),
        ({"engaged": False}, Reason.NOT_ENGAGED, Phase.HOLDING),
        ({"battery": 0.05}, Reason.BATTERY, Phase.DONE),
    ],
)
def test_what_the_robot_says_of_itself_stops_it(says, reason, phase):
    class Unwell(Telling):
        pass

    rig = Rig(Unwell).driving()
    Unwell.says = says
    status = rig.step(0.1, GO)
    assert (status.phase, status.stopped, status.sent, status.takeover) == (phase, reason, ZERO, False)
    assert "warning" in {event.level for event in rig.link.drain_events()}
    assert rig.platform.sent[-1] == ZERO
    Unwell.says = {}
    assert rig.step(0.5, GO).phase is phase


def test_a_low_battery_is_noted_each_time_that_it_becomes_low():
    class Tired(Telling):
        pass

    rig = Rig(Tired).driving()
    for charge in (0.15, 0.9, 0.15):
        Tired.says = {"battery": charge}
        assert rig.step(0.2, GO).phase is Phase.ACTIVE
    notes = [event for event in rig.link.drain_events() if event.message == Reason.BATTERY_LOW]
    assert [event.level for event in notes] == ["warning", "warning"]


def test_what_cannot_be_watched_is_noted_when_engaging():
    class Silent(Telling):
        says: ClassVar[dict] = {"pose": None, "battery": None}

    notes = [event.message for event in Rig(Silent).driving().link.drain_events()]
    assert [note.split()[0] for note in notes if "not monitored" in note] == ["geofence", "battery"]
    assert not [event for event in Rig().driving().link.drain_events() if "not monitored" in event.message]


def test_a_state_that_was_read_before_the_engagement_stops_nothing():
    """Engaging ends in another thread, between the link's look at the robot and its judgement."""

    class Slow(FakePlatform):
        def state(self):
            state = super().state()
            if ending:
                ending.pop()()
            return state

    ending, manoeuvres = [], []
    rig = Rig(Slow)
    rig.link = Link(
        rig.platform, rig.profile.limits, rig.clock, lambda: rig.setpoint, spawn=manoeuvres.append
    )
    rig.link.engage()
    ending.append(manoeuvres.pop())
    assert rig.step(1 / RATE_HZ, GO).phase is Phase.ACTIVE
    assert rig.step(2.0, GO).sent == GO


def test_a_robot_that_refuses_a_command_is_held_with_its_reason():
    class Refusing(FakePlatform):
        def send(self, command, now_ns):
            raise PlatformError("the wire is cut")

    rig = Rig(Refusing)
    rig.link.engage()
    status = rig.step(0.1, GO)
    assert (status.reasons, status.stopped) == ((Reason.REFUSED,), "the wire is cut")


def test_an_engage_that_fails_ends_with_its_reason():
    class Grounded(FakePlatform):
        def engage(self):
            raise PlatformError("no GPS fix")

    rig = Rig(Grounded)
    rig.link.engage()
    assert (rig.link.status.phase, rig.link.status.stopped) == (Phase.DONE, "no GPS fix")
    assert any("no GPS fix" in event.message for event in rig.link.drain_events())


def test_an_adapters_bug_while_engaging_is_a_failure_with_a_reason():
    class Broken(FakePlatform):
        def engage(self):
            raise ZeroDivisionError("oops")

    rig = Rig(Broken)
    rig.link.engage()
    assert rig.link.status.phase is Phase.DONE
    assert "ZeroDivisionError" in rig.link.status.stopped


def test_it_never_engages_twice():
    rig = Rig().driving()
    rig.link.disengage("done")
    rig.link.engage()
    assert rig.step(0.5, GO).phase is Phase.DONE


def test_its_time_outs_stay_in_machine_time_at_any_speed():
    limits = wall_timeouts(fake_profile().limits, 5.0)
    assert limits.command_timeout_s == pytest.approx(5 * fake_profile().limits.command_timeout_s)
    assert limits.state_timeout_s == pytest.approx(5 * fake_profile().limits.state_timeout_s)
    assert limits.sight_timeout_s == pytest.approx(5 * fake_profile().limits.sight_timeout_s)
    assert limits.forward_m_s == fake_profile().limits.forward_m_s


class Slow(FakePlatform):
    """Takes 3 ms to send."""

    def send(self, twist, now_ns):
        self.clock.advance(0.003)
        return super().send(twist, now_ns)


def test_a_set_point_that_is_sent_again_keeps_the_time_at_which_it_first_was():
    rig = Rig(Slow)
    rig.link.engage()
    rig.clock.advance(0.02)
    rig.setpoint = Setpoint(GO, rig.clock.now_ns())
    rig.clock.advance(0.004)
    judged_ns = rig.clock.now_ns()
    first = Acted(rig.setpoint.t_ns, judged_ns, judged_ns + 3_000_000)
    assert rig.link.step(judged_ns).acted == first
    assert rig.step(0.1).acted == first
    assert rig.step(0.02, ZERO).acted.setpoint_ns == rig.setpoint.t_ns


def test_a_set_point_that_was_stopped_was_never_sent():
    rig = Rig().driving()
    before = rig.link.status.acted
    assert rig.step(0.02, Twist(vx=math.nan)).phase is Phase.HOLDING
    assert rig.link.status.acted == before
