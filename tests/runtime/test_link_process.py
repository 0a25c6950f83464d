"""The link outlives its tracker, and ends by itself once the robot is at rest."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import pytest

from adatracker_deploy.core.clock import MonotonicClock
from adatracker_deploy.core.errors import PlatformError
from adatracker_deploy.core.messages import Twist
from adatracker_deploy.runtime import link_process
from adatracker_deploy.runtime.gate import Setpoint
from adatracker_deploy.runtime.link import Phase
from adatracker_deploy.runtime.link_process import LinkProcess
from adatracker_deploy.testing.fake import FakeConnection, FakePlatform, fake_profile
from tests.tiers import EXHAUSTIVE

pytestmark = pytest.mark.slow

TIMEOUT_S = 30.0


def eventually(condition, what: str):
    """Wait until `condition()` gives something true, and return it."""
    deadline_s = time.monotonic() + TIMEOUT_S
    while not (found := condition()):
        assert time.monotonic() < deadline_s, what
        os.sched_yield()
    return found


@pytest.fixture
def clock():
    return MonotonicClock()


@pytest.fixture
def link(clock):
    with LinkProcess(FakePlatform, fake_profile(), clock) as link:
        yield link


def in_phase(link, phase):
    status = link.status()
    return status if status and status.phase is phase else None


def test_a_whole_drive_through_the_process(link, clock):
    (check,) = link.connect()
    assert check.ok
    link.engage()
    eventually(lambda: in_phase(link, Phase.ACTIVE), "engages")

    def moving():
        link.send(Setpoint(Twist(vx=0.5), clock.now_ns()))
        status = link.status()
        return status.sent.vx == 0.5 and status.state.velocity.vx > 0.3

    eventually(moving, "moves as told")
    link.hold("enough")
    assert eventually(lambda: in_phase(link, Phase.HOLDING), "holds").stopped == "enough"
    link.disengage("enough")
    eventually(lambda: in_phase(link, Phase.DONE), "disengages")
    assert any("holding" in event.message for event in link.drain_events())


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGHUP], ids=lambda number: number.name)
def test_what_a_terminal_tells_its_group_while_it_starts_does_not_reach_it(link, number):
    """Only the tracker decides what to do about Ctrl-C and a lost terminal, which a run may outlive."""
    os.kill(link.pid, number)
    (check,) = link.connect()
    assert check.ok


def test_when_the_tracker_falls_silent_it_gives_up_the_robot_by_itself(link, clock):
    link.connect()
    link.engage()
    eventually(lambda: in_phase(link, Phase.ACTIVE), "engages")
    link.send(Setpoint(Twist(vx=0.5), clock.now_ns()))
    done = eventually(lambda: in_phase(link, Phase.DONE), "gives up")
    assert done.stopped == "command_lost"


def test_a_robot_that_cannot_be_reached_is_told_with_its_reason(clock):
    with (
        LinkProcess(Unreachable, fake_profile(), clock) as link,
        pytest.raises(PlatformError, match="nobody answers"),
    ):
        link.connect()


class Unreachable(FakePlatform):
    def connect(self):
        raise PlatformError("nobody answers")


def test_a_link_that_was_killed_is_noticed(link):
    link.connect()
    os.kill(link.pid, signal.SIGKILL)
    eventually(lambda: not link.alive(), "ends")
    link.hold("too late")
    assert link.drain_events() == []


def test_sigterm_disengages_before_it_ends(link):
    link.connect()
    link.engage()
    eventually(lambda: in_phase(link, Phase.ACTIVE), "engages")
    os.kill(link.pid, signal.SIGTERM)
    eventually(lambda: not link.alive(), "ends")
    assert link.status().phase is Phase.DONE
    assert link.status().stopped == "terminated"


def test_a_stop_while_engaging_ends_the_engage(clock):
    slow = replace(fake_profile(), connection=FakeConnection(engage_s=10.0))
    with LinkProcess(FakePlatform, slow, clock) as link:
        link.connect()
        link.engage()
        eventually(lambda: in_phase(link, Phase.ENGAGING), "begins to engage")
        began_s = time.monotonic()
        link.disengage("changed my mind")
        eventually(lambda: in_phase(link, Phase.DONE), "stops engaging")
        assert time.monotonic() - began_s < 5.0


TRACKER = """
import sys
from adatracker_deploy.core.messages import Twist
from adatracker_deploy.core.clock import MonotonicClock
from adatracker_deploy.runtime.gate import Setpoint
from adatracker_deploy.runtime.link import Phase
from adatracker_deploy.runtime.link_process import LinkProcess
from adatracker_deploy.testing.fake import FakePlatform, fake_profile

if __name__ == "__main__":
    clock = MonotonicClock()
    link = LinkProcess(FakePlatform, fake_profile(), clock)
    link.connect()
    link.engage()
    while True:
        link.send(Setpoint(Twist(vx=0.5), clock.now_ns()))
        if link.status().sent.vx == 0.5:
            print(link.pid, flush=True)
        clock.sleep_until(clock.now_ns() + 20_000_000)
"""


def test_a_killed_tracker_takes_the_link_with_it_only_after_the_robot_is_at_rest(tmp_path):
    script = tmp_path / "tracker.py"
    script.write_text(TRACKER)
    with subprocess.Popen([sys.executable, str(script)], stdout=subprocess.PIPE, text=True) as tracker:
        link_pid = int(tracker.stdout.readline())
        tracker.kill()
    eventually(lambda: not Path(f"/proc/{link_pid}").exists(), "the link ends")


@EXHAUSTIVE
def test_a_link_that_hangs_is_noticed_and_not_waited_for(clock):
    link = LinkProcess(FakePlatform, fake_profile(), clock)
    link.connect()
    os.kill(link.pid, signal.SIGSTOP)
    began_s = time.monotonic()
    eventually(lambda: not link.alive(), "is missed")
    link.close()
    assert time.monotonic() - began_s < 10.0
    assert link._process.exitcode == -signal.SIGKILL  # it wakes up no more


class Deaf(FakePlatform):
    """Waits for a robot that is not there."""

    def connect(self):
        time.sleep(TIMEOUT_S)


def test_a_link_that_still_connects_is_not_waited_for(clock):
    link = LinkProcess(Deaf, fake_profile(), clock)
    began_s = time.monotonic()
    link.close()
    assert time.monotonic() - began_s < TIMEOUT_S / 2


class Seldom(FakePlatform):
    """Its link has a slot in a quarter of an hour, but for what it is woken for."""

    def connect(self):
        link_process.RATE_HZ = 0.001
        super().connect()


@pytest.mark.parametrize(
    "told",
    [lambda link: link.send(Setpoint(Twist(vx=0.5), 1)), lambda link: link.engage()],
    ids=["set-point", "request"],
)
def test_what_it_is_told_does_not_wait_for_its_next_slot(clock, told):
    with LinkProcess(Seldom, fake_profile(), clock) as link:
        link.connect()
        first = eventually(lambda: link.status() if link.status().t_ns else None, "its first slot")
        told(link)
        eventually(lambda: link.status().t_ns > first.t_ns, "steps between two slots")
