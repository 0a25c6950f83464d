"""Processes are watched from outside: who runs, who was stopped, who is gone, and how busy the cores are."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time

import pytest

from adatracker_deploy.faults.process_monitor import ProcessMonitor, Seen
from adatracker_deploy.faults.take_off import reached
from adatracker_deploy.sim.ground_truth import Account, Flying, GroundTruthRecorder

LINK = """
import pathlib, sys
pathlib.Path("/proc/self/comm").write_text("adatracker-link")
print("up", flush=True)
sys.stdin.read()
"""
TRACKER = f"import subprocess, sys; subprocess.run([sys.executable, '-c', {LINK!r}])"


@pytest.fixture
def tracker():
    process = subprocess.Popen(
        [sys.executable, "-c", TRACKER], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    process.stdout.readline()  # its link is up, too
    yield process
    process.stdin.close()
    process.kill()
    process.wait()
    process.stdout.close()


def eventually(look):
    end_s = time.monotonic() + 10
    while look() is None:
        assert time.monotonic() < end_s
        time.sleep(0.01)


def test_a_stopped_and_a_killed_process_are_seen_by_their_role(tracker, tmp_path):
    path, began_ns = tmp_path / "witness.txt", time.monotonic_ns()
    robot = GroundTruthRecorder(path)
    robot.process("robot")  # this test stands in for it

    def first(role, state):
        return watch.seen().first(role, state, began_ns, time.monotonic_ns())

    with ProcessMonitor(tracker.pid, path) as watch:
        for role in ("tracker", "link", "robot"):
            eventually(lambda role=role: first(role, "runs"))
        assert watch.link_lives
        os.kill(tracker.pid, signal.SIGSTOP)
        eventually(lambda: first("tracker", "stopped"))
        assert first("link", "stopped") is None
        os.kill(tracker.pid, signal.SIGCONT)
        link = watch._link
        os.kill(link, signal.SIGKILL)
        eventually(lambda: first("link", "gone"))
        assert not watch.link_lives
    eventually(lambda: first("tracker", "gone"))
    assert first("robot", "gone") is None
    robot.close()


def test_a_busy_core_is_told_from_an_idle_one():
    seen = Seen(busy_ns=tuple((t * 10**8, t * 2 * 10**8 if t > 10 else 0) for t in range(30)))
    assert seen.busy_cores(0, 10**9) == 0.0
    assert seen.busy_cores(15 * 10**8, 25 * 10**8) == pytest.approx(2.0)
    assert seen.busy_cores(10**12, 10**13) == 0.0  # nobody looked


def test_a_program_that_burns_is_seen(tmp_path):
    began_ns = time.monotonic_ns()
    with ProcessMonitor(os.getpid(), tmp_path / "none") as watch:
        while time.monotonic_ns() < began_ns + 10**9:
            pass
    assert watch.seen().busy_cores(began_ns, began_ns + 10**9) > 0.5


def test_a_take_off_is_known_by_arms_and_height():
    armed = Account(modes=((1, "HOLD", False), (2, "TAKEOFF", True)))
    assert reached(Account()) == ()
    assert reached(Account(modes=((1, "HOLD", False),))) == ()
    assert reached(armed) == ("armed",)
    assert reached(Account(modes=armed.modes, flight=(Flying(3, 0.8, 0.6),))) == ("armed", "climbing")
