"""Logged commands judged again: what other limits would have changed, and what cannot be said."""

from __future__ import annotations

import dataclasses
import math
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from adatracker_deploy.core.messages import Twist
from adatracker_deploy.replay.compare import Spread, apart
from adatracker_deploy.replay.judged import judge_again, without_gaps
from adatracker_deploy.replay.view import ranges
from adatracker_deploy.runtime.gate import Reason
from tests.replay.trials import LIMITS, moving

LIMITS = dataclasses.replace(LIMITS, ramp_s=0.2)


def judged(steps, **changes):
    return judge_again(steps, dataclasses.replace(LIMITS, **changes))


def test_a_command_within_the_limits_is_sent_as_it_is_once_the_ramp_is_over():
    found = judged(moving(30))
    assert found.stop is None
    assert found.ticks[-1].sent == Twist(vx=1.0)
    assert found.ticks[-1].reasons == frozenset()
    assert 0 in found.reasons()[Reason.RAMP]
    assert max(found.reasons()[Reason.RAMP]) <= 2


def test_under_tighter_limits_the_same_commands_are_clipped_and_said_to_be():
    found = judged(moving(30), forward_m_s=0.6)
    assert found.reasons()[Reason.ENVELOPE] == list(range(30))
    assert found.ticks[-1].sent == Twist(vx=0.6)


def test_people_who_came_too_close_hold_the_robot_back_again():
    steps = [dataclasses.replace(step, others_share=0.2 if step.step == 10 else 0.0) for step in moving(40)]
    found = judged(steps)
    assert found.reasons()[Reason.TOO_CLOSE] == list(range(10, 21))  # a second at 10 Hz
    assert judged(steps, switched_off=("too_close",)).reasons().get(Reason.TOO_CLOSE) is None


def test_a_fence_is_laid_around_the_first_tick_and_stops_for_good():
    found = judged(moving(60), fence_radius_m=2.0)
    assert found.stop is Reason.GEOFENCE
    # It moves 0.1 m a tick, and a stop from 1 m/s, 0.2 s late and at 2 m/s^2, takes 0.45 m.
    assert found.ticks[-1].step == 16
    assert found.ticks[-1].sent == Twist()


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"battery": 0.05}, Reason.BATTERY),
        ({"state_age_s": 3.0}, Reason.STATE_LOST),
        ({"state_age_s": math.inf}, Reason.STATE_LOST),
        ({"command": Twist(vx=math.nan)}, Reason.NOT_FINITE),
    ],
)
def test_what_would_stop_a_robot_stops_it_here(changes, reason):
    steps = moving(20)
    found = judged([*steps[:10], *(dataclasses.replace(step, **changes) for step in steps[10:])])
    assert (found.stop, found.ticks[-1].step) == (reason, 10)


def test_a_tick_that_came_late_lets_its_command_grow_old():
    steps = moving(20)
    late = [dataclasses.replace(step, t_ns=step.t_ns + 300_000_000 * (step.step > 9)) for step in steps]
    assert judged(late).reasons()[Reason.STALE] == [9]


def test_what_changed_a_command_for_a_part_of_its_tick_is_told():
    steps = moving(20)
    slower = dataclasses.replace(steps[10], command=Twist(vx=0.95))
    found = judged([*steps[:10], slower, *steps[11:]], jerk_m_s3=200.0)
    assert found.ticks[10].sent == Twist(vx=0.95)  # it has got there before the tick is over
    assert Reason.ACCELERATION in found.ticks[10].reasons


def test_a_tick_that_lasts_for_years_stops_and_comes_to_an_end():
    steps = moving(3)
    found = judged([*steps[:2], dataclasses.replace(steps[2], t_ns=2**62)])
    assert (found.stop, found.ticks[-1].step) == (Reason.COMMAND_LOST, 1)


def test_ticks_behind_a_missing_one_are_not_judged():
    steps = moving(20)
    assert without_gaps([*steps[:7], *steps[9:]]) == steps[:7]
    assert without_gaps(steps) == steps
    assert without_gaps([]) == []
    assert judge_again([], LIMITS).ticks == ()


@given(st.sets(st.integers(0, 60)))
def test_ranges_tell_every_number_and_no_other(numbers):
    found = list(ranges(sorted(numbers)))
    assert [number for a, b in found for number in range(a, b + 1)] == sorted(numbers)
    assert all(b + 1 < c for (_, b), (c, _) in pairwise(found))


@given(st.lists(st.tuples(st.floats(), st.floats()), min_size=1, max_size=20))
def test_the_spread_is_zero_for_equal_courses_and_names_the_largest(pairs):
    before, after = [a for a, _ in pairs], [b for _, b in pairs]
    ticks = list(range(10, 10 + len(pairs)))
    assert Spread.of(ticks, before, before) == Spread(0.0, 0.0, 10)
    found = Spread.of(ticks, before, after)
    alone = [Spread.of([0], [a], [b]).most for a, b in pairs]
    assert found.most == max(alone) == alone[found.at - 10]
    assert 0 <= found.mean <= found.most * (1 + 1e-9)


@pytest.mark.parametrize(
    ("before", "after", "most"),
    [
        (1.0, 1.5, 0.5),
        (math.nan, math.nan, 0.0),
        (math.inf, math.inf, 0.0),
        (math.nan, 1.0, math.inf),
        (1.0, math.nan, math.inf),
    ],
)
def test_what_is_no_number_is_infinitely_far_from_any_and_near_its_like(before, after, most):
    assert Spread.of([7], [before], [after]) == Spread(most, most, 7)


def test_axes_that_nobody_uses_are_left_out():
    assert set(apart([0], [Twist(vx=1)], [Twist(yaw_rate=0.5)])) == {"vx", "yaw_rate"}
