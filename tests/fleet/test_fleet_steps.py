"""A fleet starts together, and the failure of one is dealt with as its file says."""

from __future__ import annotations

import signal

import pytest

from adatracker_deploy.app.fleet_steps import Standing, Step, next_step, worst

STARTING, CHECKED, READY = 0, 1, 2


def step(*robots, released=READY, on_failure="stop-all"):
    standings = [Standing(f"robot-{place}", *robot) for place, robot in enumerate(robots)]
    return next_step(standings, released, on_failure)


@pytest.mark.parametrize("on_failure", ["stop-all", "go-on"])
def test_nobody_goes_on_before_all_have_come_as_far(on_failure):
    for released, ahead in ((0, CHECKED), (1, READY)):
        one, other = (ahead, None), (ahead - 1, None)
        assert step(one, other, released=released, on_failure=on_failure) == (Step.WAIT, "")
        assert step(one, one, released=released, on_failure=on_failure) == (Step.RELEASE, "")
    assert step(one, one, on_failure=on_failure) == (Step.WAIT, "")


@pytest.mark.parametrize("status", [1, 2, 130, -9])
def test_a_failure_stops_all_unless_the_file_says_otherwise(status):
    for released, reached in ((1, CHECKED), (2, READY)):
        robots = ((READY, None), (reached, status))
        assert step(*robots, released=released) == (Step.STOP, "robot-1")
        assert step(*robots, released=released, on_failure="go-on")[0] is not Step.STOP
    assert step((READY, None), (CHECKED, status), released=1, on_failure="go-on") == (Step.RELEASE, "")


@pytest.mark.parametrize("on_failure", ["stop-all", "go-on"])
def test_a_request_that_is_refused_stops_all_before_anything_is_opened(on_failure):
    refused = ((CHECKED, None), (STARTING, 2))
    assert step(*refused, released=0, on_failure=on_failure) == (Step.STOP, "robot-1")


def test_a_robot_that_ends_with_a_result_stops_nobody():
    assert step((READY, None), (READY, 0)) == (Step.WAIT, "")
    assert step((READY, 0), (READY, 0)) == (Step.OVER, "")
    assert step((READY, 0), (READY, 1)) == (Step.OVER, "")


def test_the_exit_status_is_the_worst():
    assert worst([0, 0]) == 0
    assert worst([0, 130, 0]) == 130
    assert worst([130, 2]) == 2
    assert worst([130, 2, 1, 0]) == 1
    assert worst([0, -signal.SIGKILL]) == 1
    assert worst([130, -signal.SIGTERM, -signal.SIGINT]) == 130
