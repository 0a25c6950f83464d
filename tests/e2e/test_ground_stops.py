"""However a run ends, a ground robot at 0.5 m/s soon stands; an observer on its own wire measures it.

The fault matrix injects all other faults, and reads the simulator's own record.

The limits are what a prototype of this software measured from 0.5 m/s, deceleration included, on quiet
machines, plus a quarter of a second for two busy cores.
"""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from tests.policy.servers import serving
from tests.tiers import EXHAUSTIVE

from .conftest import started
from .ground_robots import ROBOTS

pytestmark = [pytest.mark.slow, pytest.mark.timeout(120)]

CRUISE_M_S = 0.4
BUSY_S = 0.25
TOLD_S = 0.55 + BUSY_S
"""Limit if the stop command reaches the robot."""
ROBOTS_OWN_S = 1.08 + BUSY_S
"""Limit if no more commands come: the robot's own time-out of 0.5 s, then its braking."""
LEASE_S = 1.5 + BUSY_S
"""Limit if the connection freezes: nothing more comes, and each side finds out by itself."""


ON_ONE = pytest.mark.parametrize(
    "robot", ["wheeled", pytest.param("quadruped", marks=EXHAUSTIVE)], indirect=True
)
"""For stops that the toolkit does by itself; those that depend on wire or robot run with both robots."""


@pytest.fixture(params=ROBOTS)
def robot(request, tmp_path):
    robot = ROBOTS[request.param](tmp_path, "--scenario", '{"seed": 3, "target_speed_m_s": 0.5}')
    with contextlib.closing(robot):
        yield robot


@pytest.fixture
def drive(tmp_path, robot):
    """Start the command against the robot, whose simulator was started by hand."""
    with started(
        tmp_path, "--platform", robot.name, "--profile", str(robot.profile), "--segmenter", "truth"
    ) as start:
        yield start


def stopped(measured, robot, what: str, onset_s: float, limit_s: float) -> float:
    halted_s = robot.watcher.halted_after(onset_s)
    way_m = robot.watcher.gone_m(onset_s)
    measured(f"{robot.name} at 0.5 m/s, {what}: stands after {halted_s:.2f} s, {way_m:.2f} m on")
    assert halted_s < limit_s
    return halted_s


def strike(measured, robot, what: str, action, limit_s: float) -> float:
    robot.watcher.wait_until_cruising(CRUISE_M_S)
    onset_s = time.monotonic()
    action()
    return stopped(measured, robot, what, onset_s, limit_s)


@EXHAUSTIVE
@ON_ONE
def test_at_its_normal_end_it_stands(drive, robot, measured):
    run = drive("--steps", "150", "--json")
    robot.watcher.wait_until_cruising(CRUISE_M_S)
    status, summary, err = run.end()
    assert status == 0, err
    measured(f"{robot.name} at 0.5 m/s, normal end: below 0.25 m/s after {summary['stop_s']:.2f} s")
    assert summary["outcome"] == "completed"
    assert summary["stop_s"] < TOLD_S
    assert robot.watcher.samples[-1].speed_m_s < 0.05


@EXHAUSTIVE
@ON_ONE
def test_after_an_unexpected_error_it_stands(drive, robot, measured):
    failing = [sys.executable, str(Path(__file__).with_name("failing_tracker.py"))]
    run = drive("--steps", "2000", command=failing)
    assert any(line.strip() == "failing" for line in run.process.stdout)
    stopped(measured, robot, "exception", time.monotonic(), TOLD_S)


@EXHAUSTIVE
@ON_ONE
def test_a_tracker_that_dies(drive, robot, measured):
    run = drive("--steps", "2000")
    strike(measured, robot, "tracker, SIGKILL", lambda: os.kill(run.pid, signal.SIGKILL), ROBOTS_OWN_S)


@EXHAUSTIVE
@ON_ONE
def test_its_policys_server_is_killed(drive, robot, measured):
    with serving() as (server, uri):
        run = drive("--steps", "2000", "--json", "--policy", uri)
        strike(measured, robot, "policy's server, kill -9", server.kill, TOLD_S)
        status, summary, err = run.end()
    assert (status, summary["outcome"]) == (1, "system_fault")
    assert f"policy {uri}: the server is gone" in summary["reason"]
    assert summary["far_ms"]["round_trip"]["p50"] > summary["far_ms"]["server"]["p50"] > 0
    assert "round trip" in err  # in the table


@EXHAUSTIVE
def test_an_unplugged_cable(drive, robot, measured):
    run = drive("--steps", "2000", "--json")
    strike(measured, robot, "cable unplugged", robot.cable.cut, ROBOTS_OWN_S)
    robot.cable.mend()
    robot.watcher.halted_after(time.monotonic())  # a cable that comes back resumes nothing
    status, summary, _ = run.end()
    assert status == 1
    assert summary["outcome"] in ("safety_stop", "system_fault")
    assert summary["reason"]


@EXHAUSTIVE
def test_a_frozen_connection_and_its_return(drive, robot, measured):
    run = drive("--steps", "2000", "--json")
    strike(measured, robot, "frozen connection", robot.cable.freeze, LEASE_S)
    robot.cable.mend()
    robot.watcher.halted_after(time.monotonic())  # what was under way when it froze moves nothing
    status, _, _ = run.end()
    assert status == 1


@EXHAUSTIVE
def test_a_robot_that_dies_ends_the_run_with_a_sentence(drive, robot):
    run = drive("--steps", "2000", "--json")
    robot.watcher.wait_until_cruising(CRUISE_M_S)
    onset_s = time.monotonic()
    robot.simulator.kill()
    with contextlib.suppress(subprocess.TimeoutExpired):
        run.process.wait(20)
    status, summary, err = run.end()
    assert time.monotonic() - onset_s < 15
    assert status == 1
    assert summary["reason"]
    assert "Traceback" not in err
