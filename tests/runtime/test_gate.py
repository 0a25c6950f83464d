"""The gate lets nothing out that is not finite, inside the envelope and smooth; and a stop latches."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from adatracker_deploy.platform import ZERO, Limits, Twist
from adatracker_deploy.runtime.gate import LONGEST_STEP_S, GateState, Setpoint, Stage, judge

LIMITS = Limits(
    forward_m_s=1.5,
    backward_m_s=0.5,
    lateral_m_s=0.3,
    vertical_m_s=0.8,
    yaw_rate_rad_s=1.2,
    accel_m_s2=2.0,
    yaw_accel_rad_s2=4.0,
    command_timeout_s=0.2,
    hold_after_s=0.5,
    disengage_after_s=1.5,
)
START_NS = 10_000_000_000
anything = st.floats(allow_nan=True, allow_infinity=True)
twists = st.builds(Twist, anything, anything, anything, anything)


def after(seconds: float) -> int:
    return START_NS + round(seconds * 1e9)


def inside(twist: Twist) -> bool:
    slack = 1e-9
    return (
        -LIMITS.backward_m_s - slack <= twist.vx <= LIMITS.forward_m_s + slack
        and abs(twist.vy) <= LIMITS.lateral_m_s + slack
        and abs(twist.vz) <= LIMITS.vertical_m_s + slack
        and abs(twist.yaw_rate) <= LIMITS.yaw_rate_rad_s + slack
    )


@given(st.lists(st.tuples(twists, st.floats(0.0, 0.3), st.floats(-0.2, 0.6)), max_size=30))
def test_whatever_comes_in_the_output_is_finite_inside_and_smooth(steps):
    state, now_ns = GateState(armed_ns=START_NS), START_NS
    for twist, pause_s, age_s in steps:
        before, now_ns = state, now_ns + round(pause_s * 1e9)
        state, verdict = judge(LIMITS, state, Setpoint(twist, now_ns - round(age_s * 1e9)), now_ns)
        out = verdict.twist
        assert out.is_finite()
        assert inside(out)
        if verdict.stage is Stage.OBEY:
            dt_s = min((now_ns - before.last_ns) / 1e9, LONGEST_STEP_S)
            allowed = LIMITS.accel_m_s2 * dt_s + 1e-9
            assert math.hypot(out.vx - before.last.vx, out.vy - before.last.vy) <= allowed
            assert abs(out.vz - before.last.vz) <= allowed
            assert abs(out.yaw_rate - before.last.yaw_rate) <= LIMITS.yaw_accel_rad_s2 * dt_s + 1e-9
        else:
            assert out == ZERO


@given(st.lists(twists, min_size=1, max_size=5))
def test_after_a_stop_no_command_moves_anything(commands):
    state, _ = judge(LIMITS, GateState(armed_ns=START_NS), Setpoint(Twist(math.nan), START_NS), START_NS)
    for i, twist in enumerate(commands):
        now_ns = after(0.02 * (i + 1))
        state, verdict = judge(LIMITS, state, Setpoint(twist, now_ns), now_ns)
        assert verdict.twist == ZERO
        assert verdict.stage is Stage.HOLD
        assert state.stopped == "not_finite"


def test_a_steady_command_inside_the_limits_arrives_unchanged():
    state = GateState(armed_ns=START_NS, last_ns=START_NS)
    wanted = Twist(1.0, 0.1, -0.2, 0.5)
    for i in range(1, 60):
        state, verdict = judge(LIMITS, state, Setpoint(wanted, after(0.02 * i)), after(0.02 * i))
    assert verdict.twist == wanted
    assert verdict.reasons == ()


def test_the_ramp_takes_as_long_as_the_acceleration_says():
    state, steps = GateState(armed_ns=START_NS, last_ns=START_NS), 0
    verdict = None
    while verdict is None or verdict.twist.vx < 1.0:
        steps += 1
        now_ns = after(0.02 * steps)
        state, verdict = judge(LIMITS, state, Setpoint(Twist(1.0), now_ns), now_ns)
    assert steps * 0.02 == pytest.approx(1.0 / LIMITS.accel_m_s2, abs=0.021)


@pytest.mark.parametrize(
    ("age_s", "stage"),
    [(0.19, Stage.OBEY), (0.21, Stage.ZERO), (0.49, Stage.ZERO), (0.51, Stage.HOLD), (1.51, Stage.DISENGAGE)],
)
def test_an_ageing_command_is_replaced_by_zero_then_a_hold_then_given_up(age_s, stage):
    state = GateState(armed_ns=START_NS, last=Twist(1.0), last_ns=after(age_s - 0.02))
    _, verdict = judge(LIMITS, state, Setpoint(Twist(1.0), START_NS), after(age_s))
    assert verdict.stage is stage
    assert (verdict.twist == ZERO) == (stage is not Stage.OBEY)


def test_a_late_command_is_obeyed_again_but_from_zero():
    state, _ = judge(LIMITS, GateState(armed_ns=START_NS), Setpoint(Twist(1.0), START_NS), after(0.3))
    state, verdict = judge(LIMITS, state, Setpoint(Twist(1.0), after(0.32)), after(0.32))
    assert verdict.stage is Stage.OBEY
    assert 0 < verdict.twist.vx <= LIMITS.accel_m_s2 * 0.02 + 1e-9


def test_a_setpoint_from_before_arming_does_not_count():
    state = GateState(armed_ns=after(1.0), last_ns=after(1.0))
    _, verdict = judge(LIMITS, state, Setpoint(Twist(1.0), after(0.99)), after(1.02))
    assert verdict.twist == ZERO
    assert verdict.stage is Stage.OBEY


def test_without_any_setpoint_the_robot_stands_and_is_given_up_in_time():
    state = GateState(armed_ns=START_NS)
    assert judge(LIMITS, state, None, after(0.1))[1].twist == ZERO
    assert judge(LIMITS, state, None, after(1.6))[1].stage is Stage.DISENGAGE


def test_a_setpoint_from_the_future_cannot_outlive_its_sender():
    state = GateState(armed_ns=START_NS)
    _, verdict = judge(LIMITS, state, Setpoint(Twist(1.0), after(100.0)), after(0.1))
    assert verdict.twist == ZERO
    assert verdict.stage is Stage.DISENGAGE


def test_the_reasons_name_what_was_changed():
    state = GateState(armed_ns=START_NS, last=Twist(1.5), last_ns=START_NS)
    assert judge(LIMITS, state, Setpoint(Twist(9.0), after(0.02)), after(0.02))[1].reasons == ("envelope",)
    _, verdict = judge(LIMITS, replace(state, last=ZERO), Setpoint(Twist(1.0), after(0.02)), after(0.02))
    assert verdict.reasons == ("acceleration",)
