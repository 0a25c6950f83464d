"""Real loop, link, gate and policy in lock-step: what they log is replayed without a difference, gate too."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, field, replace

import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from adatracker_deploy.core.clock import FakeClock
from adatracker_deploy.core.messages import Frame, Seen
from adatracker_deploy.policy.bundle import load_bundle
from adatracker_deploy.policy.onnx_policy import OnnxPolicy
from adatracker_deploy.registry import load_profile
from adatracker_deploy.replay.judged import SLOT_NS
from adatracker_deploy.replay.trial_again import ask_again, gate_again
from adatracker_deploy.runtime.dry_run import DryRun
from adatracker_deploy.runtime.gate import Setpoint
from adatracker_deploy.runtime.link import Link
from adatracker_deploy.runtime.loop import Loop
from adatracker_deploy.trial.reader import read_trial
from adatracker_deploy.trial.step_json import STEP_FORMAT
from adatracker_deploy.trial.trial_file import TrialFile
from tests.policy import tiny
from tests.replay.trials import GREY, SEED, observations


@dataclass(slots=True)
class SlottedClock(FakeClock):
    """Time passes in the link's slots: each is served before a later time is reached."""

    link: Link | None = None
    slot_ns: int = 0

    def sleep_until(self, t_ns):
        while self.link is not None and self.slot_ns < t_ns:
            self.t_ns = max(self.t_ns, self.slot_ns)
            self.link.step(self.slot_ns)
            self.slot_ns += SLOT_NS
        self.t_ns = max(self.t_ns, t_ns)


@dataclass
class Trial:
    """One trial of the scout, dry; `fresh` says at which ticks there is a new frame."""

    policy: OnnxPolicy
    fresh: list[bool]
    clock: SlottedClock = field(default_factory=SlottedClock)
    setpoint: Setpoint | None = None
    seen: Seen | None = None

    def __post_init__(self):
        self.profile = load_profile("scout")
        self.left = list(zip(self.fresh, observations(len(self.fresh)), strict=True))
        robot = DryRun(self.profile, self.clock)
        self.link = Link(robot, self.profile.limits, self.clock, lambda: self.setpoint, spawn=lambda do: do())
        self.link.engage()
        self.clock.link, self.clock.slot_ns = self.link, self.clock.t_ns

    def send(self, setpoint):
        self.setpoint = setpoint

    def status(self):
        return self.link.status

    def alive(self):
        return True

    def observe(self, patience_s):
        new, observation = self.left.pop(0)
        if new or self.seen is None:
            t_ns = self.clock.now_ns() - 7_654_321
            self.seen = Seen(Frame(GREY, t_ns, observation.seq), replace(observation, t_ns=t_ns))
        return self.seen

    def run(self, file):
        """Log the trial as the writer would; return its ending."""
        config = {
            "profile": asdict(self.profile),
            "policy_sha256": dict(self.policy.info.sha256),
            "seed": SEED,
            "speed": 1.0,
        }
        about = {"step_format": str(STEP_FORMAT), "platform": "wheeled", "kind": "dry", "policy": "tiny"}
        about["steps"] = "9"
        shown = set()
        with file.open("wb") as stream:
            log = TrialFile(stream, {"trial": about, "config": {"yaml": yaml.safe_dump(config)}})

            def write(record, seen):
                if seen.frame.seq not in shown:
                    shown.add(seen.frame.seq)
                    log.picture(
                        record.t_ns, seen.frame.t_ns, seen.frame.seq, seen.frame.rgb, seen.observation.mask
                    )
                log.step(record.t_ns, seen.frame.t_ns, record)

            self.policy.reset(SEED)
            loop = Loop(
                observe=self.observe,
                policy=self.policy,
                link=self,
                limits=self.profile.limits,
                clock=self.clock,
                write=write,
            )
            ending = loop.run(len(self.fresh) - 1)
            log.finish(json.dumps({"outcome": ending.outcome}))
        return ending


@pytest.fixture(scope="module")
def policy(tmp_path_factory):
    folder = tmp_path_factory.mktemp("bundle")
    tiny.Parts().write(folder)
    return OnnxPolicy(load_bundle(folder))


def runs_of_frames(longest_gap):
    """Ticks with a new frame and, after each, up to so many without."""
    return st.lists(st.integers(0, longest_gap), min_size=1, max_size=25).map(
        lambda gaps: [tick == 0 for gap in gaps for tick in range(gap + 1)]
    )


@settings(max_examples=30)
@given(fresh=runs_of_frames(5))
def test_whatever_frames_came_the_replay_is_the_trial_and_so_is_the_gate(policy, tmp_path_factory, fresh):
    file = tmp_path_factory.mktemp("lockstep") / "trial.mcap"
    assert Trial(policy, fresh).run(file).outcome == "completed"
    trial = read_trial(file)
    again = ask_again(trial, policy)
    assert (again.first, again.same, again.replayed.gap) == (None, True, None)
    assert len(again.replayed.answers) + again.replayed.idle == len(fresh)
    idle = [step.step for step in trial.steps if not step.action]
    assert again.replayed.idle == len(idle)
    # A frame is 8 ms old at its tick, 208 ms two ticks later, and too old from the third on.
    assert idle == [n for n in range(len(fresh)) if not any(fresh[max(0, n - 2) : n + 1])]
    gate = gate_again(trial, load_profile("scout").limits)
    assert (gate.changed, gate.before, gate.notes) == ({}, gate.after, ())
    assert all(spread.most == 0 for spread in gate.agreement.values())


def test_the_lock_step_moves_and_its_gate_has_something_to_do(policy, tmp_path):
    """Else the agreement above would be one of zeros."""
    file = tmp_path / "trial.mcap"
    Trial(policy, [True] * 30).run(file)
    gate = gate_again(read_trial(file), load_profile("scout").limits)
    assert max(abs(tick.sent.vx) for tick in gate.before.ticks) > 0.1
    assert len(gate.before.reasons()) >= 3
    *steps, last = read_trial(file).steps
    assert [step.sent.vx for step in steps] == [tick.sent.vx for tick in gate.before.ticks[:-1]]
    assert last.sent is None  # the trial was over before the link had answered
