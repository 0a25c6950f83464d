"""The loop acts on fresh observations only, ends for the right reason and writes every tick down."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from adatracker_deploy.core.clock import FakeClock
from adatracker_deploy.core.errors import PlatformError
from adatracker_deploy.core.messages import ZERO, Click, Pick, TargetState, Twist
from adatracker_deploy.policy.base import STALE_OBSERVATION_S
from adatracker_deploy.runtime.link import LinkStatus, Phase
from adatracker_deploy.runtime.loop import BLIND_S, MISSED_IN_A_ROW, Ending
from tests.runtime.loop_in_memory import BOX, FLYING, RGB, STEPS, Rehearsal


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
    assert rehearsal.others[9:13] == [1 / 16, None, None, 1 / 16]
    assert [record.others_share for record in rehearsal.records[9:13]] == [1 / 16, None, None, 1 / 16]
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
        ({"contact": "another person"}, "collision", "the robot touched another person"),
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


def test_a_camera_that_is_silent_because_the_tracker_stood_still_is_not_the_cause():
    class Woken(Rehearsal):
        def observe(self, patience_s):
            seen = super().observe(patience_s)
            if self.tick == 5:
                raise PlatformError("camera: no picture has come for 3.0 s")
            return seen

    held = replace(FLYING, phase=Phase.HOLDING, stopped="command_lost")
    assert Woken(at={5: {"status_now": held}}).run() == Ending("safety_stop", "command_lost")
    with pytest.raises(PlatformError, match="no picture"):
        Woken().run()


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
