"""However a run ends, a ROS 2 robot at 0.5 m/s soon stands; another node measures it from its odometry.

The limits are those of the other ground robots (tests/e2e/test_ground_stops.py).
"""

import contextlib
import os
import signal
import time

import pytest

from tests.tiers import EXHAUSTIVE

pytest.importorskip("rclpy", reason="ROS 2 is not installed: pip install 'adatracker-deploy[ros2]'")

from tests.e2e.conftest import started
from tests.e2e.test_ground_stops import CRUISE_M_S, LEASE_S, ROBOTS_OWN_S, TOLD_S
from tests.ros2.by_hand import Ros2Robot

pytestmark = [pytest.mark.slow, pytest.mark.timeout(120)]

STILL_M_S = 0.05


@pytest.fixture
def robot(tmp_path):
    with contextlib.closing(
        Ros2Robot(tmp_path, "--scenario", '{"seed": 3, "target_speed_m_s": 0.5}')
    ) as robot:
        yield robot


@pytest.fixture
def drive(tmp_path, robot):
    """Start the command against the robot, whose simulator was started by hand."""
    common = "--platform", "ros2", "--profile", str(robot.profile), "--segmenter", "truth"
    with started(tmp_path, *common) as start:
        yield start


def interrupt_at(run, words):
    """Press Ctrl-C as soon as the command says that a phase begins; return the time and all that it said."""
    said = []
    for line in run.process.stdout:
        said.append(line)
        if words in line:
            break
    assert words in said[-1], said
    run.process.send_signal(signal.SIGINT)
    struck_s = time.monotonic()
    said.extend(run.process.stdout)
    return struck_s, "".join(said), run.process.wait(60)


def strike(measured, robot, what, action, limit_s):
    robot.watcher.wait_until_cruising(CRUISE_M_S)
    onset_s = time.monotonic()
    action()
    halted_s = robot.watcher.halted_after(onset_s)
    way_m = robot.watcher.gone_m(onset_s)
    measured(f"ros2 at 0.5 m/s, {what}: stands after {halted_s:.2f} s, {way_m:.2f} m on")
    assert halted_s < limit_s


def test_ctrl_c_while_it_engages_moves_nothing(drive, robot):
    _, said, status = interrupt_at(drive("--steps", "2000"), "engaging")
    assert status == 130, said
    assert "following for" not in said
    assert max(sample.speed_m_s for sample in robot.watcher.samples) < STILL_M_S


@EXHAUSTIVE
def test_ctrl_c_while_it_drives(drive, robot, measured):
    run = drive("--steps", "2000", "--json")
    strike(measured, robot, "Ctrl-C", lambda: run.process.send_signal(signal.SIGINT), TOLD_S)
    status, summary, err = run.end()
    assert (status, summary["outcome"]) == (130, "interrupted"), err
    assert "stopped by the operator" in summary["reason"]


@EXHAUSTIVE
def test_ctrl_c_while_it_stops_changes_nothing_about_its_end(drive, robot, measured):
    struck_s, said, status = interrupt_at(drive("--steps", "100"), "; stopping")
    assert "completed; stopping" in said, said
    assert status in (0, 130), said
    halted = [sample for sample in robot.watcher.samples if sample.t_s > struck_s]
    last = max((sample.t_s for sample in halted if sample.speed_m_s > STILL_M_S), default=struck_s)
    measured(f"ros2 at 0.5 m/s, Ctrl-C while it stops: stands {last - struck_s:.2f} s after it")
    assert last - struck_s < TOLD_S
    assert robot.watcher.samples[-1].speed_m_s < STILL_M_S


@EXHAUSTIVE
def test_a_tracker_that_dies(drive, robot, measured):
    run = drive("--steps", "2000")
    strike(measured, robot, "tracker, SIGKILL", lambda: os.kill(run.pid, signal.SIGKILL), TOLD_S)


@EXHAUSTIVE
def test_a_link_that_dies_leaves_it_to_the_robots_own_time_out(drive, robot, measured):
    run = drive("--steps", "2000", "--json")
    strike(measured, robot, "link, SIGKILL", lambda: os.kill(run.link_pid(), signal.SIGKILL), ROBOTS_OWN_S)
    status, summary, err = run.end()
    assert status == 1, err
    assert "link" in summary["reason"]


@EXHAUSTIVE
def test_a_suspended_link_and_its_return(drive, robot, measured):
    run = drive("--steps", "2000", "--json")
    link = None

    def suspend():
        nonlocal link
        link = run.link_pid()
        os.kill(link, signal.SIGSTOP)

    strike(measured, robot, "link, SIGSTOP", suspend, ROBOTS_OWN_S)
    with contextlib.suppress(ProcessLookupError):
        os.kill(link, signal.SIGCONT)
    robot.watcher.halted_after(time.monotonic())  # what waited for it moves nothing
    status, summary, err = run.end()
    assert status == 1, err
    assert summary["reason"]


@EXHAUSTIVE
def test_a_suspended_tracker_and_its_return(drive, robot, measured):
    run = drive("--steps", "2000", "--json")
    strike(measured, robot, "tracker, SIGSTOP", lambda: os.kill(run.pid, signal.SIGSTOP), TOLD_S)
    os.kill(run.pid, signal.SIGCONT)
    robot.watcher.halted_after(time.monotonic())
    status, _, err = run.end()
    assert status == 1, err


@EXHAUSTIVE
def test_a_robot_that_froze_moves_nothing_when_it_thaws(drive, robot, measured):
    run = drive("--steps", "2000", "--json")
    robot.watcher.wait_until_cruising(CRUISE_M_S)
    robot.simulator.send_signal(signal.SIGSTOP)
    status, summary, err = run.end()
    assert status == 1, err
    assert "no odometry" in summary["reason"]
    robot.simulator.send_signal(signal.SIGCONT)
    thawed_s = time.monotonic()
    halted_s = robot.watcher.halted_after(thawed_s)
    measured(f"ros2 at 0.5 m/s, robot frozen: stands {halted_s:.2f} s after it thaws")
    assert halted_s < LEASE_S


@EXHAUSTIVE
def test_a_robot_that_dies_ends_the_run_with_a_sentence(drive, robot):
    run = drive("--steps", "2000", "--json")
    robot.watcher.wait_until_cruising(CRUISE_M_S)
    onset_s = time.monotonic()
    robot.simulator.kill()
    status, summary, err = run.end()
    assert time.monotonic() - onset_s < 15
    assert status == 1
    assert summary["reason"]
    assert "Traceback" not in err
