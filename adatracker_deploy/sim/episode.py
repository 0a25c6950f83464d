"""Runs a policy for one episode in lock-step: world, body and policy in this process, without link or
clock."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from adatracker_deploy.config.limits import Limits
from adatracker_deploy.core.messages import Box, Twist
from adatracker_deploy.platform import Body
from adatracker_deploy.policy.base import Policy, to_twist
from adatracker_deploy.sim.backend import WorldBackend
from adatracker_deploy.sim.task import Outcome, Task, TaskSettings


@dataclass(frozen=True, slots=True)
class Step:
    """One completed step of an episode."""

    command: Twist
    reward: float
    visible: bool
    distance_m: float
    bearing_rad: float
    box: Box | None
    collided: bool


@dataclass(frozen=True, slots=True)
class EpisodeResult:
    """A complete episode."""

    outcome: Literal["completed", "lost"]
    steps: tuple[Step, ...]

    @property
    def ar(self) -> float:
        """Accumulated reward: the sum over all steps."""
        return math.fsum(step.reward for step in self.steps)

    @property
    def el(self) -> int:
        """Episode length in steps."""
        return len(self.steps)

    @property
    def success(self) -> bool:
        """Whether the horizon was reached."""
        return self.outcome == "completed"

    @property
    def visibility(self) -> float:
        """Share of the steps in which the target was visible."""
        return sum(step.visible for step in self.steps) / len(self.steps)


def run_episode(
    world: WorldBackend,
    body: Body,
    policy: Policy,
    limits: Limits,
    *,
    steps: int = 500,
    rate_hz: float | None = None,
    mask_size: tuple[int, int] = (64, 64),
    fov_rad: float = math.pi / 2,
    substeps: int = 1,
    seed: int = 0,
) -> EpisodeResult:
    """Run `policy` from the start of a fresh world until the episode ends.

    Args:
        world: not stepped yet.
        body: reset here, with `seed`.
        policy: reset here, with `seed`.
        limits: turn actions into velocities; there is no other gate.
        steps: the horizon.
        rate_hz: step rate, Hz; by default the policy's.
        mask_size: height and width of the policy's masks, px.
        fov_rad: the camera's horizontal field of view.
        substeps: steps of the body's dynamics per step.
        seed: seeds body and policy; the world has its own.
    """
    settings = TaskSettings(
        rate_hz=rate_hz or policy.info.rate_hz,
        steps=steps,
        mask_size=mask_size,
        fov_rad=fov_rad,
        substeps=substeps,
    )
    task = Task(world, body, settings)
    policy.reset(seed)
    observation = task.begin(seed)
    made: list[Step] = []
    while True:
        command = to_twist(policy.act(observation).values, policy.info.action, limits)
        outcome = task.step(command)
        made.append(_step(command, outcome))
        if outcome.end:
            return EpisodeResult(outcome.end, tuple(made))
        observation = outcome.observation


def _step(command: Twist, outcome: Outcome) -> Step:
    truth = outcome.truth
    return Step(
        command,
        outcome.reward,
        outcome.visible,
        truth.distance_m,
        truth.bearing_rad,
        outcome.observation.box,
        truth.contact is not None,
    )
