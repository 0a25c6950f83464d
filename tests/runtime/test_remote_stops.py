"""A policy elsewhere that is late, silent, frozen or gone stops any robot: loop, link and gate in real time.

All of it is real but the robot's wire (a dry run) and its camera: the policy's server is another process or
thread behind a socket, the link is its own process, and the limits are those of the shipped profiles. What
the link hands to the robot is watched from outside.
"""

from __future__ import annotations

import contextlib
import os
import signal
import threading
import time
from dataclasses import dataclass, field

import numpy as np
import pytest

pytest.importorskip("websockets", reason="needs the extra 'remote'")

from adatracker_deploy.core.clock import MonotonicClock
from adatracker_deploy.core.errors import PlatformError
from adatracker_deploy.core.messages import ZERO, Box, Frame, Observation, Seen
from adatracker_deploy.policy.base import STALE_OBSERVATION_S
from adatracker_deploy.registry import load_profile
from adatracker_deploy.runtime.dry_run import DryRun
from adatracker_deploy.runtime.engagement import Engagement
from adatracker_deploy.runtime.link_process import LinkProcess
from adatracker_deploy.runtime.loop import BLIND_S, Ending, Loop
from tests.policy.servers import MANIFEST, asking, saying, serving
from tests.tiers import EXHAUSTIVE

pytestmark = pytest.mark.slow


def profiles(everyday):
    """Take each robot's limits, on each run this one's; each robot has a run of its own in this file."""
    names = ("scout", "go2", "px4_quad")
    return [name if name == everyday else pytest.param(name, marks=EXHAUSTIVE) for name in names]


LOOP_MANIFEST = MANIFEST | {"rate_hz": 20.0, "observation": ["mask"]}
PICTURE_AGE_S = 0.02
SLOT_S = 0.02
"""Period of the link."""
BUSY_S = 0.25
"""What two busy cores may add."""
MASK, RGB = np.zeros((48, 64), np.uint8), np.zeros((48, 64, 3), np.uint8)
BOX = Box(0.3, 0.5, 0.08, 0.2)


@dataclass
class Robot:
    """A loop that follows a person who is always seen."""

    profile: object
    policy: object
    link: LinkProcess
    clock: MonotonicClock
    records: list = field(default_factory=list)
    moved_s: float = 0.0
    """When the link last sent anything but zero."""
    ending: Ending | str = ""
    seq: int = 0

    def observe(self, patience_s):
        self.seq += 1
        t_ns = self.clock.now_ns() - round(PICTURE_AGE_S * 1e9)
        return Seen(Frame(RGB, t_ns, self.seq), Observation(MASK, BOX, 1.0, t_ns, self.seq))

    def follow(self, steps):
        """Run the loop, and stop as a trial does."""
        loop = Loop(
            observe=self.observe,
            policy=self.policy,
            link=self.link,
            limits=self.profile.limits,
            clock=self.clock,
            write=lambda record, seen: self.records.append(record),
        )
        try:
            self.ending = loop.run(steps)
        except PlatformError as error:
            self.ending = str(error)
        Engagement(self.link, self.clock, lambda what: None).stand_still("ended")

    def watch(self, over):
        while not over.is_set():
            status = self.link.status()
            if status and status.sent != ZERO:
                self.moved_s = time.monotonic()
            time.sleep(0.005)  # a poll, of what comes every 20 ms

    @contextlib.contextmanager
    def following(self, steps):
        """Begin; go on inside once it drives; at the end wait until the loop has ended."""
        over = threading.Event()
        threads = [
            threading.Thread(target=self.watch, args=(over,)),
            threading.Thread(target=self.follow, args=(steps,)),
        ]
        for thread in threads:
            thread.start()
        try:
            wait_for(lambda: self.moved_s, "the robot drives")
            yield
        finally:
            threads[1].join(30)
            over.set()
            threads[0].join(10)
        assert not threads[1].is_alive()


def wait_for(condition, what, within_s=20.0):
    end_s = time.monotonic() + within_s
    while not condition():
        assert time.monotonic() < end_s, what
        time.sleep(0.005)


@contextlib.contextmanager
def engaged(name, uri):
    clock, profile = MonotonicClock(), load_profile(name)
    with asking(uri) as policy, LinkProcess(DryRun, profile, clock) as link:
        link.connect()
        Engagement(link, clock, lambda what: None).begin()
        policy.reset(0)
        yield Robot(profile, policy, link, clock)


def ahead(message, number):
    return {"actions": np.array([0.5, 0.1])}


@pytest.mark.parametrize("name", profiles("scout"))
def test_a_delay_of_300_ms_stops_the_robot_and_then_the_trial(name, measured):
    """From the first late answer on nothing that is older than the gate allows moves it."""
    late = threading.Event()

    def delayed(message, number):
        if late.is_set():
            time.sleep(0.3)
        return ahead(message, number)

    with saying(delayed, LOOP_MANIFEST) as (uri, _), engaged(name, uri) as robot:
        with robot.following(200):
            late.set()
            onset_s = time.monotonic()
        stopped_s = robot.moved_s - onset_s
        limit_s = robot.profile.limits.sight_timeout_s
    measured(f"{name}, 300 ms more on the way to its policy: zero is sent after {stopped_s:.2f} s")
    assert stopped_s < limit_s + SLOT_S + BUSY_S
    assert robot.ending.outcome == "safety_stop"
    assert "the policy is late" in robot.ending.reason


@EXHAUSTIVE
@pytest.mark.parametrize("name", profiles("go2"))
def test_with_a_fifth_of_the_answers_dropped_it_follows_on_what_is_fresh_and_nothing_else(name, measured):
    def dropping(message, number):
        return None if number % 5 == 4 else {"actions": np.array([0.5, message["request"] % 100 / 1000])}

    with saying(dropping, LOOP_MANIFEST) as (uri, _), engaged(name, uri) as robot, robot.following(100):
        pass
    acted = [record for record in robot.records if record.action]
    ages_ms = [record.latency.answer_age_ms for record in acted]
    assert robot.ending == Ending("completed")
    assert len(acted) > 30
    assert max(ages_ms) <= STALE_OBSERVATION_S * 1e3
    stood = sum(record.stale for record in robot.records)
    measured(
        f"{name}, a fifth of the answers dropped: {len(acted)} of {len(robot.records)} ticks acted on, "
        f"the oldest picture {max(ages_ms):.0f} ms, {stood} ticks at zero"
    )


@pytest.mark.parametrize("name", profiles("px4_quad"))
@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGSTOP], ids=["killed", "frozen"])
def test_a_server_that_is_killed_or_frozen_stops_the_robot(name, how, measured):
    with serving() as (process, uri), engaged(name, uri) as robot:
        with robot.following(200):
            os.kill(process.pid, how)
            onset_s = time.monotonic()
        stopped_s, ended_s = robot.moved_s - onset_s, time.monotonic() - onset_s
        limit_s = robot.profile.limits.sight_timeout_s
    word = "killed" if how == signal.SIGKILL else "frozen"
    measured(f"{name}, its policy's server {word}: zero is sent after {stopped_s:.2f} s")
    assert stopped_s < limit_s + SLOT_S + BUSY_S
    if how == signal.SIGKILL:
        assert "the server is gone" in robot.ending
    else:
        assert "the policy is late" in robot.ending.reason
        assert ended_s > BLIND_S
