"""A robot that judges the age of commands by their stamps needs a clock that agrees with this machine's."""

import pytest

from adatracker_deploy.runtime.robot_clock import FURTHEST_S, clock_ahead_s, clocks_check

NOW_NS = 1_800_000_000_000_000_000


@pytest.mark.parametrize("apart_s", [-FURTHEST_S, -0.2, 0.0, 0.02, FURTHEST_S])
def test_clocks_that_agree_pass(apart_s):
    assert clocks_check(apart_s).ok


@pytest.mark.parametrize(
    ("apart_s", "says"),
    [
        (60.0, "60 s ahead of the robot, whose own time-out is as much later"),
        (-0.4, "0.4 s behind the robot, which takes commands for as much older"),
        (1.7e9, "set both by NTP"),
    ],
)
def test_a_clock_that_puts_off_the_robots_own_time_out_is_refused(apart_s, says):
    check = clocks_check(apart_s)
    assert (check.ok, check.blocking) == (False, True)
    assert says in check.message


def test_a_robot_without_stamps_is_told_and_may_go_on():
    check = clocks_check(clock_ahead_s(0, NOW_NS))
    assert (check.ok, check.blocking) == (False, False)


def test_the_difference_is_by_the_robots_stamp():
    assert clock_ahead_s(NOW_NS - 2 * 10**9, NOW_NS) == 2.0
    assert clock_ahead_s(NOW_NS + 10**9, NOW_NS) == -1.0
