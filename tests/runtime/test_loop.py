"""The loop acts on fresh observations only, ends for the right reason and writes every tick down."""

from __future__ import annotations

import itertools
from dataclasses import dataclass, field, replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from adatracker_deploy.config.limits import Limits
from adatracker_deploy.core.clock import FakeClock
from adatracker_deploy.core.geometry import Pose
from adatracker_deploy.core.messages import (
    ZERO,
    Action,
    Answer,
    Box,
    Click,
    Frame,
    Observation,
    Pick,
    PlatformState,
    Seen,
    TargetState,
    Truth,
    Twist,
)
from adatracker_deploy.policy.base import FORWARD_YAW, STALE_OBSERVATION_S, NoAnswer, PolicyInfo
from adatracker_deploy.runtime.link import Acted, LinkStatus, Phase
from adatracker_deploy.runtime.loop import BLIND_S, MISSED_IN_A_ROW, Ending, Loop
from adatracker_deploy.runtime.phase import WAIT

LIMITS = Limits(forward_m_s=2.0, backward_m_s=1.0, yaw_rate_rad_s=1.0, accel_m_s2=2.0, yaw_accel_rad_s2=4.0)
BOX = Box(0.5, 0.5, 0.2, 0.6)
MASK = np.zeros((4, 4), np.uint8)
RGB = np.zeros((4, 4, 3), np.uint8)
STEPS = 100
FLYING = LinkStatus(Phase.ACTIVE, PlatformState(1, "OFFBOARD", True, False))
INFO = PolicyInfo(name="half", rate_hz=20.0, action=FORWARD_YAW)


@dataclass
class Rehearsal:
    """A whole loop in memory; `at` maps a tick to what is different from then on."""

    clock: FakeClock = field(default_factory=FakeClock)
    at: dict[int, dict] = field(default_factory=dict)
    tick: int = -1
    box: Box | None = BOX
    age_s: float = 0.02
    collided: bool = False
    status_now: LinkStatus | None = FLYING
    living: bool = True
    frame: bool = True
    waited_s: float = 0.0
    """How long each tick waits for its observation."""
    stall_s: float = 0.0
    """How long the tracker gets no processor time in each tick."""
    commands: list[Twist] = field(default_factory=list)
    sent_ns: list[int] = field(default_factory=list)
    shares: list[float | None] = field(default_factory=list)
    sight_ages_s: list[float] = field(default_factory=list)
    records: list = field(default_factory=list)
    asked: int = 0
    shown: list = field(default_factory=list)
    silent: bool = False
    """The policy is on another machine, and has not answered yet."""
    target: TargetState | None = None
    pick: Pick | None = None
    answer_behind_s: float | None = None
    """The policy is on another machine, its newest answer to a picture so much older than the newest."""
    info: PolicyInfo = INFO

    def observe(self, patience_s):
        self.patience_s = patience_s
        self.clock.advance(self.waited_s)
        self.tick += 1
        for name, value in self.at.get(self.tick, {}).items():
            setattr(self, name, value)
        t_ns = self.clock.now_ns() - round(self.age_s * 1e9)
        truth = Truth(MASK, Pose(), Pose(), (2.5, 0.0), 2.5, 0.1, self.collided)
        frame = Frame(RGB, t_ns, self.tick, truth)
        observation = Observation(MASK, self.box, 1.0, t_ns, self.tick, self.target, pick=self.pick)
        seen = Seen(frame, observation, taken_ns=t_ns + 4_000_000, ready_ns=t_ns + 13_000_000)
        return seen if self.frame else None

    def act(self, observation):
        self.asked += 1
        self.shown.append(observation)
        self.clock.advance(self.stall_s)
        if self.silent:
            raise NoAnswer
        answer = None
        if self.answer_behind_s is not None:
            t_ns = observation.t_ns - round(self.answer_behind_s * 1e9)
            answer = Answer(t_ns, queue_ms=1.0, round_trip_ms=9.0, server_ms=5.0)
        return Action(np.array([0.5, -0.5], np.float32), answer=answer)

    def reset(self, seed=0): ...

    def send(self, twist, now_ns, target_share=None, seen_ns=None, held_until_ns=None):
        self.commands.append(twist)
        self.sent_ns.append(now_ns)
        self.shares.append(target_share)
        self.sight_ages_s.append((now_ns - seen_ns) / 1e9)

    def status(self):
        return self.status_now

    def alive(self):
        return self.living

    def run(self) -> Ending:
        loop = Loop(
            observe=self.observe,
            policy=self,
            link=self,
            limits=LIMITS,
            clock=self.clock,
            write=lambda record, seen: self.records.append(record),
        )
        return loop.run(STEPS)


def test_a_whole_trial_has_its_steps_and_the_tick_of_reference():
    rehearsal = Rehearsal()
    assert rehearsal.run() == Ending("completed")
    assert [record.step for record in rehearsal.records] == list(range(STEPS + 1))
    assert set(rehearsal.commands) == {Twist(vx=1.0, yaw_rate=-0.5)}
    gaps = np.diff([record.t_ns for record in rehearsal.records])
    assert set(gaps) == {50_000_000}


def test_forty_nine_lost_steps_in_a_row_do_not_end_it():
    rehearsal = Rehearsal(at={10: {"box": None}, 59: {"box": BOX}})
    assert rehearsal.run().outcome == "completed"
    assert sum(record.box is None for record in rehearsal.records) == 49


def test_the_fiftieth_lost_step_in_a_row_ends_it():
    rehearsal = Rehearsal(at={10: {"box": None}})
    assert rehearsal.run().outcome == "lost"
    assert rehearsal.records[-1].step == 59


def test_a_stale_observation_is_not_acted_on_and_is_neither_seen_nor_lost():
    rehearsal = Rehearsal(at={10: {"age_s": STALE_OBSERVATION_S + 0.01}, 12: {"age_s": 0.02}})
    assert rehearsal.run().outcome == "completed"
    assert rehearsal.commands[9:13] == [Twist(1.0, yaw_rate=-0.5), ZERO, ZERO, Twist(1.0, yaw_rate=-0.5)]
    assert [record.box for record in rehearsal.records[9:13]] == [BOX, None, None, BOX]
    assert [record.stale for record in rehearsal.records[9:13]] == [False, True, True, False]
    assert rehearsal.shares[9:13] == [pytest.approx(0.12), None, None, pytest.approx(0.12)]
    assert rehearsal.asked == STEPS + 1 - 2
    assert rehearsal.sight_ages_s[9:13] == pytest.approx([0.02, 0.23, 0.23, 0.02])  # which the gate is told


def test_until_a_newly_chosen_target_is_seen_zero_is_commanded_and_the_policy_is_not_asked():
    tracked, choosing = TargetState.TRACKED, TargetState.CHOOSING
    picked = Pick(Click(1, 9, 0.5, 0.5), BOX, 1)
    rehearsal = Rehearsal(
        target=tracked,
        at={10: {"target": choosing, "box": None, "pick": picked}, 13: {"target": tracked, "box": BOX}},
    )
    assert rehearsal.run().outcome == "completed"
    moving = Twist(1.0, yaw_rate=-0.5)
    assert rehearsal.commands[9:14] == [moving, ZERO, ZERO, ZERO, moving]
    assert rehearsal.asked == STEPS + 1 - 3
    held = rehearsal.records[10:13]
    assert [(record.stale, record.action, record.box) for record in held] == [(False, (), None)] * 3
    assert [record.target for record in held] == ["choosing"] * 3
    assert [record.picks for record in rehearsal.records[9:14]] == [None, 1, 1, 1, 1]
    assert rehearsal.sight_ages_s[9:14] == pytest.approx([0.02] * 5)  # the gate need not go blind


def test_a_newly_chosen_target_that_never_comes_is_lost_as_any_other():
    rehearsal = Rehearsal(at={10: {"target": TargetState.CHOOSING, "box": None}})
    assert rehearsal.run().outcome == "lost"
    assert rehearsal.records[-1].step == 59
    assert set(rehearsal.commands[10:]) == {ZERO}


def test_a_choice_moves_no_robot_that_has_stopped():
    stopped = LinkStatus(Phase.HOLDING, FLYING.state, stopped="geofence")
    rehearsal = Rehearsal(at={5: {"status_now": stopped}, 6: {"pick": Pick(Click(1, 5, 0.5, 0.5), BOX, 1)}})
    assert rehearsal.run() == Ending("safety_stop", "geofence")
    assert len(rehearsal.commands) == 6


def test_a_policy_is_shown_the_picture_and_what_the_robot_reports():
    rehearsal = Rehearsal()
    rehearsal.run()
    assert all(shown.image is RGB and shown.state is FLYING.state for shown in rehearsal.shown)


def test_without_an_answer_zero_is_asked_for_and_neither_seen_nor_lost():
    rehearsal = Rehearsal(at={10: {"silent": True}, 12: {"silent": False}})
    assert rehearsal.run().outcome == "completed"
    moving = Twist(1.0, yaw_rate=-0.5)
    assert rehearsal.commands[9:13] == [moving, ZERO, ZERO, moving]
    assert [record.stale for record in rehearsal.records[9:13]] == [False, True, True, False]
    assert [record.action for record in rehearsal.records[10:12]] == [(), ()]
    assert rehearsal.sight_ages_s[9:13] == pytest.approx([0.02, 0.07, 0.12, 0.02])  # the gate goes blind, too


def test_an_answer_to_an_older_picture_is_acted_on_at_that_pictures_age():
    """0.02 s old, and 0.1 s behind: loop and gate judge 0.12 s."""
    rehearsal = Rehearsal(at={10: {"answer_behind_s": 0.1}, 20: {"answer_behind_s": STALE_OBSERVATION_S}})
    rehearsal.run()
    assert rehearsal.sight_ages_s[9:12] == pytest.approx([0.02, 0.12, 0.12])
    latency = rehearsal.records[10].latency
    assert latency.answer_age_ms == pytest.approx(120)
    assert (latency.queue_ms, latency.round_trip_ms, latency.server_ms) == (1.0, 9.0, 5.0)
    assert rehearsal.records[9].latency.round_trip_ms is None
    assert set(rehearsal.commands[10:20]) == {Twist(1.0, yaw_rate=-0.5)}
    assert set(rehearsal.commands[20:]) == {ZERO}  # 0.24 s, though the newest picture is fresh
    assert rehearsal.records[20].stale


@pytest.mark.parametrize("change", [{"silent": True}, {"answer_behind_s": 0.3}])
def test_a_policy_that_is_late_for_two_seconds_ends_the_trial(change):
    rehearsal = Rehearsal(at={10: change})
    ending = rehearsal.run()
    assert (ending.outcome, ending.reason) == (
        "safety_stop",
        "the policy is late: for 2.0 s there was no answer to act on",
    )
    assert set(rehearsal.commands[10:]) == {ZERO}
    assert (rehearsal.records[-1].t_ns - rehearsal.records[9].t_ns) / 1e9 == pytest.approx(2.05)


@pytest.mark.parametrize(
    ("change", "outcome", "reason"),
    [
        ({"age_s": BLIND_S + 0.1}, "safety_stop", "no new camera frame"),
        ({"frame": False}, "system_fault", "no frame"),
        ({"living": False}, "system_fault", "link process died"),
        ({"status_now": None}, "system_fault", "link process died"),
        ({"collided": True}, "collision", "touched"),
    ],
)
def test_what_breaks_ends_the_trial_with_its_reason(change, outcome, reason):
    rehearsal = Rehearsal(at={5: change})
    ending = rehearsal.run()
    assert ending.outcome == outcome
    assert reason in ending.reason
    assert len(rehearsal.records) <= 7


@pytest.mark.parametrize(("takeover", "outcome"), [(True, "takeover"), (False, "safety_stop")])
def test_a_link_that_no_longer_drives_ends_the_trial(takeover, outcome):
    held = replace(FLYING, phase=Phase.HOLDING, stopped="why", takeover=takeover)
    assert Rehearsal(at={5: {"status_now": held}}).run() == Ending(outcome, "why")


def test_at_a_higher_speed_a_stall_is_still_measured_in_machine_time():
    rehearsal = Rehearsal(clock=FakeClock(speed=5.0), age_s=STALE_OBSERVATION_S * 4)
    rehearsal.run()
    assert rehearsal.asked == STEPS + 1


def stalled(stall_s, **changes):
    """Return a rehearsal whose tracker stands still for so long in its sixth tick, and in that alone."""
    return Rehearsal(at={5: {"stall_s": stall_s}, 6: {"stall_s": 0.0}}, **changes)


def test_slots_missed_now_and_then_are_counted_and_the_trial_goes_on():
    rehearsal = stalled(0.17)
    assert rehearsal.run() == Ending("completed")
    assert [record.missed_deadlines for record in rehearsal.records[4:8]] == [0, 0, 2, 2]


def test_three_slots_missed_in_a_row_end_the_trial_without_another_command():
    rehearsal = stalled(0.18)
    assert rehearsal.run() == Ending("safety_stop", "deadlines_missed: 3 slots in a row")
    assert len(rehearsal.commands) == len(rehearsal.records) == 6


def test_a_tracker_that_was_starved_stops_as_soon_as_it_runs_not_at_the_next_slot():
    rehearsal = stalled(0.23)
    rehearsal.run()
    assert rehearsal.clock.now_ns() == rehearsal.sent_ns[-1] + 230_000_000


def test_what_the_link_stopped_for_meanwhile_is_what_is_told():
    rehearsal = stalled(1.0)
    rehearsal.at[5]["status_now"] = replace(FLYING, phase=Phase.HOLDING, stopped="command_lost")
    assert rehearsal.run() == Ending("safety_stop", "command_lost")


def test_at_a_higher_speed_slots_in_a_row_are_counted_in_machine_time():
    assert stalled(0.7, clock=FakeClock(speed=5.0)).run().outcome == "completed"
    assert stalled(0.8, clock=FakeClock(speed=5.0)).run().outcome == "safety_stop"


@given(st.lists(st.floats(0.0, 0.4), max_size=30))
def test_whatever_stalls_there_is_no_burst_and_no_command_after_three_missed_slots(stalls):
    changes = dict(enumerate({"stall_s": stall_s} for stall_s in stalls))
    rehearsal = Rehearsal(at=changes | {len(stalls): {"stall_s": 0.0}})
    ending = rehearsal.run()
    gaps = np.diff(rehearsal.sent_ns)
    assert all(gap >= 25e6 - 1 for gap in gaps)
    assert all(gap < (MISSED_IN_A_ROW + 1.5) * 50e6 for gap in gaps)
    missed = [record.missed_deadlines for record in rehearsal.records]
    assert all(after - before < MISSED_IN_A_ROW for before, after in itertools.pairwise(missed))
    starved = any(stall_s > (MISSED_IN_A_ROW + 1) * 0.05 for stall_s in stalls)
    assert ending.outcome == "safety_stop" if starved else ending.outcome in {"completed", "safety_stop"}


def test_a_perception_that_is_always_late_ends_the_trial_for_that_and_not_for_a_target_that_was_not_seen():
    rehearsal = Rehearsal(at={10: {"age_s": STALE_OBSERVATION_S + 0.1}})
    ending = rehearsal.run()
    assert ending.outcome == "safety_stop"
    assert "perception is late" in ending.reason
    assert "not seen" not in ending.reason
    stale = [record.t_ns for record in rehearsal.records if record.stale]
    assert (stale[-1] - stale[0]) / 1e9 <= BLIND_S


def test_late_frames_now_and_then_neither_end_a_trial_nor_save_one_whose_target_is_lost():
    late = {tick: {"age_s": 0.5 if tick % 2 else 0.02} for tick in range(10, 200)}
    assert Rehearsal(at=late).run() == Ending("completed")
    rehearsal = Rehearsal(at=late | {10: {"age_s": 0.02, "box": None}})
    rehearsal.run()
    assert rehearsal.records[-1].step == STEPS  # 45 fresh looks have found nobody: five more would end it
    rehearsal = Rehearsal(
        at={tick: change for tick, change in late.items() if tick < 31} | {10: {"box": None}}
    )
    assert rehearsal.run().outcome == "lost"


class Wired(Rehearsal):
    """Its link judges every set-point 5 ms after it came and sends half of it within 2 ms more."""

    def send(self, twist, now_ns, target_share=None, seen_ns=None, held_until_ns=None):
        super().send(twist, now_ns, target_share, seen_ns)
        judged_ns = self.clock.now_ns() + 5_000_000
        acted = Acted(now_ns, judged_ns, judged_ns + 2_000_000)
        half = Twist(vx=twist.vx / 2, yaw_rate=twist.yaw_rate / 2)
        self.status_now = replace(FLYING, sent=half, reasons=(f"tick {self.tick}",), acted=acted)

    def act(self, observation):
        super().act(observation)
        return Action(np.array([self.tick / 1000, 0.0], np.float32))


def test_each_step_says_where_its_time_went_from_the_sensor_to_the_wire():
    rehearsal = Wired(stall_s=0.003)
    rehearsal.run()
    latency = rehearsal.records[3].latency
    ways = (latency.capture_ms, latency.perceive_ms, latency.wait_ms, latency.infer_ms)
    assert ways == pytest.approx((4.0, 9.0, 7.0, 3.0))
    assert latency.sensor_to_command_ms == pytest.approx(sum(ways))
    assert (latency.gate_ms, latency.send_ms) == pytest.approx((5.0, 2.0))
    assert latency.sensor_to_wire_ms == pytest.approx(latency.sensor_to_command_ms + 7.0)


def test_a_tick_that_waited_for_its_observation_begins_when_that_is_ready():
    at_once, waiting = Wired(), Wired(waited_s=0.006, age_s=0.013)
    at_once.run()
    waiting.run()
    first, second = at_once.records[3], waiting.records[3]
    assert second.t_ns - first.t_ns == pytest.approx(6e6, abs=3e6)  # the slots, too, come a little later
    assert second.latency.wait_ms == pytest.approx(0.0)
    assert second.latency.lateness_ms == first.latency.lateness_ms
    assert waiting.patience_s == pytest.approx(WAIT / INFO.rate_hz)


def test_a_record_is_one_ticks_what_was_asked_and_what_was_sent_for_it():
    rehearsal = Wired()
    rehearsal.run()
    assert [record.step for record in rehearsal.records] == list(range(STEPS + 1))
    for record in rehearsal.records:
        assert record.sent.vx == pytest.approx(record.command.vx / 2)
        assert record.gate == (f"tick {record.step}",)


def test_what_stopped_the_robot_stands_in_the_record_of_the_command_that_it_forestalled():
    stop = replace(FLYING, phase=Phase.HOLDING, stopped="not_finite", reasons=("not_finite",))
    rehearsal = Rehearsal(at={5: {"status_now": stop}})  # as the sixth tick's observation is taken
    rehearsal.run()
    assert [record.step for record in rehearsal.records] == [0, 1, 2, 3, 4, 5]
    assert (rehearsal.records[-1].sent, rehearsal.records[-1].gate) == (ZERO, ("not_finite",))


class FilmOver(Exception): ...


def test_whatever_ends_the_loop_every_tick_that_was_driven_is_written():
    rehearsal = Wired()
    observe = rehearsal.observe

    def until_the_film_is_over(patience_s):
        if rehearsal.tick == 7:
            raise FilmOver
        return observe(patience_s)

    rehearsal.observe = until_the_film_is_over
    with pytest.raises(FilmOver):
        rehearsal.run()
    assert [record.step for record in rehearsal.records] == list(range(8))
    assert rehearsal.records[-1].sent.vx == pytest.approx(rehearsal.records[-1].command.vx / 2)
