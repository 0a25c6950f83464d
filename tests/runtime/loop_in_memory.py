"""A whole loop in memory: camera, policy, link and clock are one object, which a test changes at any tick."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from adatracker_deploy.config.limits import Limits
from adatracker_deploy.core.clock import FakeClock
from adatracker_deploy.core.geometry import Pose
from adatracker_deploy.core.messages import (
    Action,
    Answer,
    Box,
    Contact,
    Frame,
    MaskClass,
    Observation,
    Pick,
    PlatformState,
    Seen,
    TargetState,
    Truth,
    Twist,
)
from adatracker_deploy.policy.base import FORWARD_YAW, NoAnswer, PolicyInfo
from adatracker_deploy.runtime.link import LinkStatus, Phase
from adatracker_deploy.runtime.loop import Ending, Loop

LIMITS = Limits(forward_m_s=2.0, backward_m_s=1.0, yaw_rate_rad_s=1.0, accel_m_s2=2.0, yaw_accel_rad_s2=4.0)
BOX = Box(0.5, 0.5, 0.2, 0.6)
MASK = np.zeros((4, 4), np.uint8)
MASK[1, 1] = MaskClass.PERSON
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
    contact: Contact | None = None
    status_now: LinkStatus | None = FLYING
    living: bool = True
    frame: bool = True
    waited_s: float = 0.0
    """How long each tick waits for its observation."""
    stall_s: float = 0.0
    """How long the tracker gets no processor time in each tick."""
    commands: list[Twist] = field(default_factory=list)
    sent_ns: list[int] = field(default_factory=list)
    shares: list[float | None] = field(default_factory=list)
    others: list[float | None] = field(default_factory=list)
    sight_ages_s: list[float] = field(default_factory=list)
    records: list = field(default_factory=list)
    asked: int = 0
    shown: list = field(default_factory=list)
    silent: bool = False
    """The policy is on another machine, and has not answered yet."""
    target: TargetState | None = None
    pick: Pick | None = None
    answer_behind_s: float | None = None
    """The policy is on another machine, its newest answer to a picture so much older than the newest."""
    info: PolicyInfo = INFO

    def observe(self, patience_s):
        self.patience_s = patience_s
        self.clock.advance(self.waited_s)
        self.tick += 1
        for name, value in self.at.get(self.tick, {}).items():
            setattr(self, name, value)
        t_ns = self.clock.now_ns() - round(self.age_s * 1e9)
        truth = Truth(MASK, Pose(), Pose(), (2.5, 0.0), 2.5, 0.1, self.contact)
        frame = Frame(RGB, t_ns, self.tick, truth)
        observation = Observation(MASK, self.box, 1.0, t_ns, self.tick, self.target, pick=self.pick)
        seen = Seen(frame, observation, taken_ns=t_ns + 4_000_000, ready_ns=t_ns + 13_000_000)
        return seen if self.frame else None

    def act(self, observation):
        self.asked += 1
        self.shown.append(observation)
        self.clock.advance(self.stall_s)
        if self.silent:
            raise NoAnswer
        answer = None
        if self.answer_behind_s is not None:
            t_ns = observation.t_ns - round(self.answer_behind_s * 1e9)
            answer = Answer(t_ns, queue_ms=1.0, round_trip_ms=9.0, server_ms=5.0)
        return Action(np.array([0.5, -0.5], np.float32), answer=answer)

    def reset(self, seed=0): ...

    def send(self, setpoint):
        self.commands.append(setpoint.twist)
        self.sent_ns.append(setpoint.t_ns)
        self.shares.append(setpoint.target_share)
        self.others.append(setpoint.others_share)
        self.sight_ages_s.append((setpoint.t_ns - setpoint.seen_ns) / 1e9)

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
