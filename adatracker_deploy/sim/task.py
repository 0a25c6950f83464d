"""The paper's task: one world, one body, and the rules of an episode."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from adatracker_deploy.core.messages import Box, Observation, Truth, Twist
from adatracker_deploy.core.task import MAX_LOST_STEPS, step_reward, target_visible
from adatracker_deploy.platform import Body
from adatracker_deploy.sim.backend import WorldBackend
from adatracker_deploy.sim.bodies import GroundBody


@dataclass(frozen=True, slots=True, kw_only=True)
class TaskSettings:
    """Settings of an episode; the defaults are the paper's, at the rate of its networks."""

    rate_hz: float = 10.0
    steps: int = 500
    """The horizon."""
    mask_size: tuple[int, int] = (64, 64)
    """Height and width, px."""
    fov_rad: float = math.pi / 2
    """Horizontal field of view."""
    substeps: int = 1
    """Steps of the body's dynamics per step of the task."""
    body_radius_m: float = 0.3
    """Radius for collisions, and for keeping a ground body out of obstacles."""
    max_lost_steps: int = MAX_LOST_STEPS
    """This many consecutive lost steps end an episode."""
    least_reward: float = -math.inf
    """Lower bound of a step's reward."""


@dataclass(frozen=True, slots=True)
class Outcome:
    """Result of one step."""

    observation: Observation
    """The observation after the step."""
    truth: Truth
    reward: float
    visible: bool
    """The target is within 90 degrees and 7.5 m, and in the mask."""
    end: Literal["", "completed", "lost"]
    """The episode's end; empty while it goes on."""


class Task:
    """One episode: `begin`, then `step` until it ends.

    After each sub-step a `GroundBody` is kept on the ground and out of obstacles, by its `place`; any other
    body is free to fly. `Truth.contact` says what it touches, obstacle or person.
    """

    def __init__(self, world: WorldBackend, body: Body, settings: TaskSettings) -> None:
        """Take a world that has not been stepped yet."""
        self.world = world
        self.body = body
        self.settings = settings
        self._count = 0
        self._lost = 0

    def begin(self, seed: int) -> Observation:
        """Place the body at the world's start; return the first observation."""
        self.body.reset(self.world.start, seed)
        self._count = self._lost = 0
        return self._look()[0]

    def step(self, command: Twist) -> Outcome:
        """Step the body under `command` (m/s, rad/s) for one period, then the people, then render."""
        period_s = 1.0 / self.settings.rate_hz
        for _ in range(self.settings.substeps):
            self.body.step(command, period_s / self.settings.substeps)
            if isinstance(self.body, GroundBody):
                self.body.place(self.world.grounded(self.body.pose, self.settings.body_radius_m))
        self.world.step(period_s, self.body.pose)
        self._count += 1
        observation, truth = self._look()
        visible = target_visible(truth.distance_m, truth.bearing_rad, observation.box is not None)
        self._lost = 0 if visible else self._lost + 1
        reward = max(step_reward(truth.distance_m, truth.bearing_rad), self.settings.least_reward)
        return Outcome(observation, truth, reward, visible, self._end())

    def _look(self) -> tuple[Observation, Truth]:
        height, width = self.settings.mask_size
        camera = self.body.camera_pose
        mask = self.world.render_mask(camera, self.settings.fov_rad, height, width)
        box = Box.of_mask(mask)
        t_ns = round(self._count * 1e9 / self.settings.rate_hz)
        observation = Observation(mask, box, 1.0 if box else 0.0, t_ns, self._count)
        return observation, self.world.truth(mask, self.body.pose, camera, self.settings.body_radius_m)

    def _end(self) -> Literal["", "completed", "lost"]:
        if self._lost >= self.settings.max_lost_steps:
            return "lost"
        return "completed" if self._count >= self.settings.steps else ""
