"""A speed gets where it is wanted as fast as acceleration and jerk allow, and no faster."""

from __future__ import annotations

import math

import pytest
from gate_rig import LIMITS, STEP_S
from hypothesis import given
from hypothesis import strategies as st

from adatracker_deploy.core.messages import ZERO, Twist
from adatracker_deploy.runtime.gate.move import ARRIVED, approach, smooth

A, J = 2.0, 20.0
SPEEDS = st.floats(-3.0, 3.0)
STEPS = st.floats(0.001, 0.1)


def course(wanted: float, speed: float = 0.0, rate: float = 0.0, seconds: float = 3.0, jerk: float = J):
    """Every speed on the way, the first one too."""
    speeds = [speed]
    for _ in range(round(seconds / STEP_S)):
        speed, rate = approach(speed, rate, wanted, STEP_S, accel=A, jerk=jerk)
        speeds.append(speed)
    return speeds


def test_it_takes_as_long_as_acceleration_and_jerk_say():
    speeds = course(1.0)
    took_s = next(i for i, speed in enumerate(speeds) if speed > 0.999) * STEP_S
    assert took_s == pytest.approx(1.0 / A + A / J, abs=2.5 * STEP_S)  # Biagiotti and Melchiorri, section 3.2
    assert speeds[-1] == 1.0


def test_without_a_limit_of_jerk_only_the_acceleration_counts():
    speeds = course(1.0, jerk=math.inf)
    assert speeds[:4] == pytest.approx([0.0, 0.04, 0.08, 0.12])
    assert speeds[25] == 1.0


@pytest.mark.parametrize("sign", [1, -1])
def test_the_first_step_is_one_of_jerk(sign):
    speed, rate = approach(0.0, 0.0, sign * 1.0, STEP_S, accel=A, jerk=J)
    assert (speed, rate) == pytest.approx((sign * J * STEP_S**2, sign * J * STEP_S))


def test_a_step_of_no_time_changes_nothing():
    assert approach(0.3, 0.7, 1.0, 0.0, accel=A, jerk=J) == (0.3, 0.7)


def test_a_rate_is_taken_back_as_slowly_as_it_was_taken_up():
    speed, rate = approach(0.5, 1.5, 0.5, STEP_S, accel=A, jerk=J)
    assert rate == pytest.approx(1.5 - J * STEP_S)
    assert speed == pytest.approx(0.5 + rate * STEP_S)


def test_the_aim_is_what_can_still_be_taken_back():
    """The root of r dt + r^2 / (2 J) = error, which for 0.13 m/s in steps of 0.1 s is 1 m/s^2."""
    speed, rate = approach(0.0, 1.0, 0.125, 0.1, accel=A, jerk=J)
    assert rate * 0.1 + rate**2 / (2 * J) == pytest.approx(0.125)
    assert speed == pytest.approx(rate * 0.1)


def test_what_is_nearly_there_is_there():
    assert approach(1.0 - 0.9 * ARRIVED, 0.0, 1.0, 1e-6, accel=A, jerk=J)[0] == 1.0
    assert approach(1.0 - 3.0 * ARRIVED, 0.0, 1.0, 1e-6, accel=A, jerk=J)[0] < 1.0
    assert ARRIVED == 1e-9


@given(SPEEDS, SPEEDS, STEPS, st.lists(STEPS, min_size=150, max_size=150))
def test_from_rest_it_never_passes_the_speed_wanted_and_gets_there(start, wanted, first_s, steps_s):
    speed, rate = start, 0.0
    low, high = min(start, wanted), max(start, wanted)
    for dt_s in (first_s, *steps_s):
        speed, rate = approach(speed, rate, wanted, dt_s, accel=A, jerk=J)
        assert low - ARRIVED <= speed <= high + ARRIVED
    if sum(steps_s) > abs(wanted - start) / A + 2 * A / J + 0.5:
        assert speed == pytest.approx(wanted, abs=1e-3)


@given(st.lists(st.tuples(SPEEDS, STEPS), min_size=2, max_size=60))
def test_acceleration_and_jerk_are_kept_and_no_bound_of_the_wanted_speeds_is_passed(steps):
    speed, rate = 0.0, 0.0
    low, high = min(0.0, *(w for w, _ in steps)), max(0.0, *(w for w, _ in steps))
    for wanted, dt_s in steps:
        before, change = speed, rate
        speed, rate = approach(speed, rate, wanted, dt_s, accel=A, jerk=J)
        assert abs(speed - before) <= A * dt_s + 2 * ARRIVED
        assert abs(rate) <= A
        assert abs(rate - change) <= J * dt_s * (1 + 1e-9)
        assert abs(speed - before - rate * dt_s) <= ARRIVED  # the rate is what happened
        assert low - ARRIVED <= speed <= high + ARRIVED


def test_each_axis_has_its_own_limits():
    """Over 0.1 s of a 2 m/s^2 and 20 m/s^3 robot that also moves sideways; jerk alone holds it back."""
    wanted = Twist(1.5, 0.3, 0.8, 1.2)
    twist, rate = smooth(LIMITS, ZERO, ZERO, wanted, 0.01, jerk=True)
    level = 20.0 * math.sqrt(0.5) * 0.01
    assert (rate.vx, rate.vy, rate.vz, rate.yaw_rate) == pytest.approx((level, level, 0.2, 0.5))
    assert (twist.vx, twist.vy, twist.vz, twist.yaw_rate) == pytest.approx(
        (level * 0.01, level * 0.01, 0.002, 0.005)
    )
    _, rate = smooth(LIMITS, ZERO, ZERO, wanted, 0.01, jerk=False)
    level = 2.0 * math.sqrt(0.5)
    assert (rate.vx, rate.vy, rate.vz, rate.yaw_rate) == pytest.approx((level, level, 2.0, 4.0))


def test_each_axis_goes_on_from_where_it_is():
    last, rate = Twist(0.5, 0.1, 0.2, 0.4), Twist(0.4, -0.3, 0.2, -0.1)
    twist, after = smooth(LIMITS, last, rate, last, 1e-4, jerk=True)
    for axis in ("vx", "vy", "vz", "yaw_rate"):
        assert getattr(twist, axis) == pytest.approx(getattr(last, axis), abs=1e-4)
        assert 0 < abs(getattr(after, axis)) < abs(getattr(rate, axis))
        assert getattr(after, axis) * getattr(rate, axis) > 0


def test_a_robot_that_does_not_move_sideways_has_the_whole_acceleration_ahead():
    from dataclasses import replace

    forward = replace(LIMITS, lateral_m_s=0.0)
    _, rate = smooth(forward, ZERO, ZERO, Twist(1.5), 0.5, jerk=False)
    assert rate.vx == pytest.approx(2.0)
    _, rate = smooth(forward, ZERO, ZERO, Twist(1.5), 0.01, jerk=True)
    assert rate.vx == pytest.approx(0.2)
