"""The loop acts on fresh observations only, ends for the right reason and writes every tick down."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
import pytest

from adatracker_deploy.geometry import Pose
from adatracker_deploy.messages import Action, Box, Frame, Observation, Truth
from adatracker_deploy.perception.pipeline import Seen
from adatracker_deploy.platform import ZERO, Limits, PlatformState, Twist
from adatracker_deploy.policy.base import FORWARD_YAW, PolicyInfo
from adatracker_deploy.runtime.clock import FakeClock
from adatracker_deploy.runtime.link import LinkStatus, Phase
from adatracker_deploy.runtime.loop import BLIND_S, STALE_OBSERVATION_S, Ending, Loop

LIMITS = Limits(forward_m_s=2.0, backward_m_s=1.0, yaw_rate_rad_s=1.0, accel_m_s2=2.0, yaw_accel_rad_s2=4.0)
BOX = Box(0.5, 0.5, 0.2, 0.6)
MASK = np.zeros((4, 4), np.uint8)
RGB = np.zeros((4, 4, 3), np.uint8)
STEPS = 100
FLYING = LinkStatus(Phase.ACTIVE, PlatformState(1, "OFFBOARD", True, False))
INFO = PolicyInfo(name="half", rate_hz=20.0, action=FORWARD_YAW)


@dataclass
class Rehearsal:
    """A whole loop in memory; `at` maps a tick to what is different from then on."""

    clock: FakeClock = field(default_factory=FakeClock)
    at: dict[int, dict] = field(default_factory=dict)
    tick: int = -1
    box: Box | None = BOX
    age_s: float = 0.02
    collided: bool = False
    status_now: LinkStatus | None = FLYING
    living: bool = True
    frame: bool = True
    commands: list[Twist] = field(default_factory=list)
    shares: list[float | None] = field(default_factory=list)
    sight_ages_s: list[float] = field(default_factory=list)
    records: list = field(default_factory=list)
    asked: int = 0
    info: PolicyInfo = INFO

    def observe(self):
        self.tick += 1
        for name, value in self.at.get(self.tick, {}).items():
            setattr(self, name, value)
        t_ns = self.clock.now_ns() - round(self.age_s * 1e9)
        truth = Truth(MASK, Pose(), Pose(), (2.5, 0.0), 2.5, 0.1, self.collided)
        seen = Seen(Frame(RGB, t_ns, self.tick, truth), Observation(MASK, self.box, 1.0, t_ns, self.tick))
        return seen if self.frame else None

    def act(self, observation):
        self.asked += 1
        return Action(np.array([0.5, -0.5], np.float32))

    def reset(self, seed=0): ...

    def send(self, twist, now_ns, target_share=None, seen_ns=None):
        self.commands.append(twist)
        self.shares.append(target_share)
        self.sight_ages_s.append((now_ns - seen_ns) / 1e9)

    def status(self):
        return self.status_now

    def alive(self):
        return self.living

    def run(self) -> Ending:
        loop = Loop(
            observe=self.observe,
            policy=self,
            link=self,
            limits=LIMITS,
            clock=self.clock,
            write=lambda record, seen: self.records.append(record),
        )
        return loop.run(STEPS)


def test_a_whole_trial_has_its_steps_and_the_tick_of_reference():
    rehearsal = Rehearsal()
    assert rehearsal.run() == Ending("completed")
    assert [record.step for record in rehearsal.records] == list(range(STEPS + 1))
    assert set(rehearsal.commands) == {Twist(vx=1.0, yaw_rate=-0.5)}
    gaps = np.diff([record.t_ns for record in rehearsal.records])
    assert set(gaps) == {50_000_000}


def test_forty_nine_lost_steps_in_a_row_do_not_end_it():
    rehearsal = Rehearsal(at={10: {"box": None}, 59: {"box": BOX}})
    assert rehearsal.run().outcome == "completed"
    assert sum(record.box is None for record in rehearsal.records) == 49


def test_the_fiftieth_lost_step_in_a_row_ends_it():
    rehearsal = Rehearsal(at={10: {"box": None}})
    assert rehearsal.run().outcome == "lost"
    assert rehearsal.records[-1].step == 59


def test_a_stale_observation_is_not_acted_on_and_counts_as_lost():
    rehearsal = Rehearsal(at={10: {"age_s": STALE_OBSERVATION_S + 0.01}, 12: {"age_s": 0.02}})
    assert rehearsal.run().outcome == "completed"
    assert rehearsal.commands[9:13] == [Twist(1.0, yaw_rate=-0.5), ZERO, ZERO, Twist(1.0, yaw_rate=-0.5)]
    assert [record.box for record in rehearsal.records[9:13]] == [BOX, None, None, BOX]
    assert rehearsal.shares[9:13] == [pytest.approx(0.12), None, None, pytest.approx(0.12)]
    assert rehearsal.asked == STEPS + 1 - 2
    assert rehearsal.sight_ages_s[9:13] == pytest.approx([0.02, 0.23, 0.23, 0.02])  # which the gate is told


@pytest.mark.parametrize(
    ("change", "outcome", "reason"),
    [
        ({"age_s": BLIND_S + 0.1}, "safety_stop", "no new camera frame"),
        ({"frame": False}, "system_fault", "no frame"),
        ({"living": False}, "system_fault", "link process died"),
        ({"status_now": None}, "system_fault", "link process died"),
        ({"collided": True}, "collision", "touched"),
    ],
)
def test_what_breaks_ends_the_trial_with_its_reason(change, outcome, reason):
    rehearsal = Rehearsal(at={5: change})
    ending = rehearsal.run()
    assert ending.outcome == outcome
    assert reason in ending.reason
    assert len(rehearsal.records) <= 7


@pytest.mark.parametrize(("takeover", "outcome"), [(True, "takeover"), (False, "safety_stop")])
def test_a_link_that_no_longer_drives_ends_the_trial(takeover, outcome):
    held = replace(FLYING, phase=Phase.HOLDING, stopped="why", takeover=takeover)
    assert Rehearsal(at={5: {"status_now": held}}).run() == Ending(outcome, "why")


def test_at_a_higher_speed_a_stall_is_still_measured_in_machine_time():
    rehearsal = Rehearsal(clock=FakeClock(speed=5.0), age_s=STALE_OBSERVATION_S * 4)
    rehearsal.run()
    assert rehearsal.asked == STEPS + 1
