"""One episode for learning and evaluation: a spec's world and body, noisy masks, normalised actions."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from adatracker_deploy.core.messages import Box, Observation
from adatracker_deploy.policy.base import FORWARD_YAW, ActionSpec, to_twist
from adatracker_deploy.sim.bodies import KinematicBody
from adatracker_deploy.sim.task import Task, TaskSettings

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from adatracker_deploy.core.messages import Truth, Twist
    from adatracker_deploy.learning.embodiment import Embodiment
    from adatracker_deploy.learning.episode_spec import EpisodeSpec

ACTION: ActionSpec = FORWARD_YAW
"""The meaning of an action's two numbers: forward, then yaw, counter-clockwise positive."""


@dataclass(frozen=True, slots=True)
class Tick:
    """Result of one step; `observation` is the policy's input, all else is ground truth."""

    observation: Observation
    dropped: bool
    """The frame of this step was lost; the mask is empty or the one before."""
    truth: Truth
    reward: float
    visible: bool
    end: Literal["", "completed", "lost"]


class Tracking:
    """`begin`, then `step` until a tick says how it ended.

    Attributes:
        embodiment: what the body is now; another than the spec's after its change.
        limits: the speeds that an action of 1 stands for now.
    """

    def __init__(self, spec: EpisodeSpec, settings: TaskSettings | None = None) -> None:
        """Build the spec's world and body.

        Args:
            spec: the episode.
            settings: the rules; by default 500 steps of the paper's.

        Raises:
            UsageError: the world or the body is not installed, or there is no such scene.
        """
        self.spec = spec
        self._become(spec.embodiment)
        self.task = Task(spec.world(), spec.embodiment.body(), settings or spec.task_settings())
        self._noise = spec.mask_noise()

    def begin(self) -> Observation:
        """Put the body 2.5 m behind the target and return the first observation, which is never augmented."""
        return self._spoil(self.task.begin(self.spec.seed))[0]

    def step(self, action: NDArray[np.float32]) -> Tick:
        """Follow an action of shape (2,), clipped to [-1, 1], for one period."""
        return self.follow(to_twist(action, ACTION, self.limits))

    def follow(self, command: Twist) -> Tick:
        """Follow a velocity command for one period."""
        outcome = self.task.step(command)
        change = self.spec.change
        if change is not None and outcome.observation.seq == change.at_step:
            self._become(change.of(self.spec.embodiment))
            self._slow_down()
        observation, dropped = self._spoil(outcome.observation)
        return Tick(observation, dropped, outcome.truth, outcome.reward, outcome.visible, outcome.end)

    def _become(self, embodiment: Embodiment) -> None:
        self.embodiment = embodiment
        self.limits = embodiment.limits()

    def _slow_down(self) -> None:
        body = self.task.body
        if isinstance(body, KinematicBody):
            body.settings = dataclasses.replace(body.settings, lag_s=self.embodiment.lag_s)

    def _spoil(self, seen: Observation) -> tuple[Observation, bool]:
        mask, dropped = self._noise(seen.mask)
        if mask is seen.mask:
            return seen, dropped
        box = Box.of_mask(mask)
        return dataclasses.replace(seen, mask=mask, box=box, confidence=1.0 if box else 0.0), dropped
