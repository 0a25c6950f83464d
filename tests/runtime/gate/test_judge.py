"""A fresh command is obeyed inside the limits, an old one replaced, and a stop latches till a new engage."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
from gate_rig import START_NS, STEP_S, WELL, Gate

from adatracker_deploy.core.messages import ZERO, Twist
from adatracker_deploy.runtime.gate import GateState, Reason, Setpoint, Stage, Stop, judge
from adatracker_deploy.runtime.gate.judge import LONGEST_STEP_S

GO = Twist(1.0, 0.1, -0.2, 0.5)


def test_a_steady_command_inside_the_limits_arrives_unchanged():
    verdict = Gate().cruise(GO)
    assert (verdict.twist, verdict.stage, verdict.reasons, verdict.warnings) == (GO, Stage.OBEY, (), ())


@pytest.mark.parametrize(
    ("age_s", "stage"),
    [
        (0.2, Stage.OBEY),
        (0.201, Stage.ZERO),
        (0.5, Stage.ZERO),
        (0.501, Stage.HOLD),
        (1.5, Stage.HOLD),
        (1.501, Stage.DISENGAGE),
    ],
)
def test_an_ageing_command_is_replaced_by_zero_then_a_hold_then_given_up(age_s, stage):
    gate = Gate()
    gate.cruise(GO)
    verdict = gate.ask(GO, age_s=age_s)
    reasons = {Stage.OBEY: (), Stage.ZERO: (Reason.STALE,)}.get(stage, (Reason.COMMAND_LOST,))
    assert (verdict.stage, verdict.reasons) == (stage, reasons)
    assert verdict.twist == (GO if stage is Stage.OBEY else ZERO)


@pytest.mark.parametrize(
    ("seen_s", "reasons"),
    [(0.27, ()), (0.271, (Reason.BLIND,)), (0.0, ()), (-1e-9, (Reason.BLIND,)), (None, ())],
)
def test_a_fresh_command_made_from_what_was_seen_long_ago_or_not_yet_is_zero_at_once(seen_s, reasons):
    gate = Gate()
    gate.cruise(GO)
    now_ns = gate.now_ns + round(STEP_S * 1e9)
    robot = replace(WELL, t_ns=now_ns)
    seen_ns = None if seen_s is None else now_ns - round(seen_s * 1e9)
    _, verdict = judge(gate.limits, gate.state, Setpoint(GO, now_ns, 0.05, seen_ns), robot, now_ns)
    assert (verdict.twist, verdict.reasons) == (ZERO if reasons else GO, reasons)
    assert verdict.stage is (Stage.ZERO if reasons else Stage.OBEY)


@pytest.mark.parametrize(("left_ns", "held"), [(1, True), (0, False), (-1, False), (None, True)])
def test_a_hand_that_does_not_hold_the_dead_man_button_is_zero_at_once_and_nothing_latches(left_ns, held):
    gate = Gate()
    gate.cruise(GO)
    now_ns = gate.now_ns + round(STEP_S * 1e9)
    robot = replace(WELL, t_ns=now_ns)
    until_ns = None if left_ns is None else now_ns + left_ns
    setpoint = Setpoint(GO, now_ns, held_until_ns=until_ns)
    state, verdict = judge(gate.limits, gate.state, setpoint, robot, now_ns)
    assert (verdict.twist, verdict.reasons) == ((GO, ()) if held else (ZERO, (Reason.DEAD_MAN,)))
    assert (state.stop, state.last) == (None, verdict.twist)


def test_a_held_button_outlives_neither_its_command_nor_a_stop():
    gate = Gate()
    gate.cruise(GO)
    held = Setpoint(GO, gate.now_ns, held_until_ns=gate.now_ns + 10**12)
    for age_s, reason in ((0.3, Reason.STALE), (0.6, Reason.COMMAND_LOST)):
        now_ns = held.t_ns + round(age_s * 1e9)
        robot = replace(WELL, t_ns=now_ns)
        gate.state, verdict = judge(gate.limits, gate.state, held, robot, now_ns)
        assert (verdict.twist, verdict.reasons) == (ZERO, (reason,))


def test_a_late_command_is_obeyed_again_but_from_zero():
    gate = Gate()
    gate.cruise(GO)
    assert gate.ask(GO, age_s=0.3).twist == ZERO
    verdict = gate.ask(GO)
    assert verdict.stage is Stage.OBEY
    assert 0 < verdict.twist.vx <= gate.limits.jerk_m_s3 * STEP_S**2
    assert Reason.RAMP not in verdict.reasons  # which belongs to engaging


def test_a_setpoint_from_before_arming_does_not_count():
    gate = Gate()
    verdict = gate.ask(GO, dt_s=0.02, age_s=0.021)
    assert (verdict.twist, verdict.stage, verdict.reasons) == (ZERO, Stage.OBEY, ())
    assert gate.ask(GO, dt_s=0.02, age_s=0.04).reasons != ()  # one from the very moment of arming does


def test_without_any_setpoint_the_robot_stands_and_is_given_up_in_time():
    gate = Gate()
    assert gate.ask(None, dt_s=0.1).twist == ZERO
    assert gate.ask(None, dt_s=1.5).stage is Stage.DISENGAGE


def test_a_setpoint_from_the_future_cannot_outlive_its_sender():
    assert Gate().ask(GO, age_s=-0.2).stage is Stage.OBEY
    verdict = Gate().ask(GO, age_s=-0.201)
    assert (verdict.twist, verdict.stage, verdict.reasons) == (ZERO, Stage.DISENGAGE, (Reason.COMMAND_LOST,))


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("axis", ["vx", "vy", "vz", "yaw_rate"])
def test_what_is_not_finite_stops_in_the_same_step_for_good(bad, axis):
    gate = Gate()
    gate.cruise(GO)
    for twist in (Twist(**{axis: bad}), GO, ZERO):
        verdict = gate.ask(twist)
        assert (verdict.twist, verdict.stage, verdict.reasons) == (ZERO, Stage.HOLD, (Reason.NOT_FINITE,))


def test_after_a_stop_only_a_new_engagement_moves_anything():
    gate = Gate()
    gate.ask(GO, engaged=False)
    assert gate.cruise(GO).twist == ZERO
    gate.state = GateState(armed_ns=gate.now_ns)
    assert gate.cruise(GO).twist == GO


def test_the_first_reason_stays_and_losing_the_command_too_gives_the_robot_up():
    gate = Gate()
    gate.ask(GO, engaged=False)
    assert gate.ask(Twist(vx=math.nan)).reasons == (Reason.NOT_ENGAGED,)
    verdict = gate.ask(GO, dt_s=2.0, age_s=2.0)
    assert (verdict.stage, verdict.reasons) == (Stage.DISENGAGE, (Reason.NOT_ENGAGED,))
    assert gate.ask(GO).stage is Stage.DISENGAGE  # it is not taken back


def test_a_clock_that_runs_backwards_stands_still():
    gate = Gate()
    gate.cruise(GO, seconds=0.3)
    moving, heard_ns = gate.state.last, gate.now_ns
    for dt_s in (-0.1, 0.1, -0.1, 0.1):
        verdict = gate.ask(GO, dt_s=dt_s, t_ns=heard_ns)
    assert verdict.twist == moving
    assert gate.state.last_ns == gate.now_ns
    assert gate.ask(GO).twist.vx > moving.vx


def test_a_clock_from_before_arming_moves_nothing():
    gate = Gate()
    gate.ask(GO, dt_s=-1.0)
    assert gate.state.last_ns == START_NS


def test_a_pause_of_the_gate_does_not_let_the_next_command_jump():
    gate = Gate()
    assert gate.cruise(Twist(yaw_rate=0.1)).twist.yaw_rate == 0.1
    verdict = gate.ask(Twist(vx=1.5), dt_s=gate.limits.hold_after_s)
    assert LONGEST_STEP_S == 0.1
    assert verdict.twist.vx <= gate.limits.accel_m_s2 * LONGEST_STEP_S
    late = Gate()
    late.cruise(Twist(yaw_rate=0.1))
    assert late.ask(Twist(vx=1.5), dt_s=LONGEST_STEP_S).twist == verdict.twist


def test_the_first_step_after_arming_is_as_long_as_it_is():
    gate = Gate(switched_off=("ramp",), lateral_m_s=0.0)
    assert gate.ask(Twist(vx=1.5)).twist.vx == pytest.approx(gate.limits.jerk_m_s3 * STEP_S**2)


def test_a_stop_is_told_by_what_the_robot_said_or_by_its_name():
    assert Stop(Reason.TAKEOVER, "the pilot").text == "the pilot"
    assert Stop(Reason.GEOFENCE).text == "geofence"


def test_an_engagement_remembers_nothing_of_the_one_before():
    fresh = GateState(armed_ns=START_NS)
    state, verdict = judge(Gate().limits, fresh, Setpoint(ZERO, START_NS), WELL, START_NS)
    assert (state.last, state.rate, state.target_m, state.stop) == (ZERO, ZERO, math.inf, None)
    assert state.moving_ns is None
    assert verdict.stage is Stage.OBEY


def test_a_gate_that_stood_still_for_as_long_as_a_lost_command_stops_however_fresh_the_next_one_is():
    gate = Gate()
    gate.cruise(GO)
    verdict = gate.ask(GO, dt_s=gate.limits.hold_after_s + 1e-3)
    assert (verdict.twist, verdict.stage, verdict.reasons) == (ZERO, Stage.HOLD, (Reason.COMMAND_LOST,))
    assert gate.ask(GO).stage is Stage.HOLD


def test_a_gate_that_stood_still_for_longer_gives_the_robot_up():
    gate = Gate()
    gate.cruise(GO)
    verdict = gate.ask(GO, dt_s=gate.limits.disengage_after_s + 1e-3)
    assert (verdict.twist, verdict.stage, verdict.reasons) == (ZERO, Stage.DISENGAGE, (Reason.COMMAND_LOST,))


def test_what_a_stop_or_a_stale_command_interrupts_starts_again_from_no_acceleration():
    for interrupted in ({"age_s": 0.3}, {"engaged": False}):
        gate = Gate()
        gate.cruise(GO, seconds=0.2)
        assert gate.state.rate.vx > 0
        assert gate.ask(GO, **interrupted).twist == ZERO
        assert gate.state.rate == ZERO


def test_a_robot_that_is_given_up_before_it_would_be_held_is_told_why():
    verdict = Gate(hold_after_s=2.0, disengage_after_s=1.5).ask(GO, dt_s=1.6, age_s=1.6)
    assert (verdict.stage, verdict.reasons) == (Stage.DISENGAGE, (Reason.COMMAND_LOST,))
