"""The full specification of one episode, as plain values: body, world, noise, seed."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Annotated

from adatracker_deploy.config.effects import NONE, Effects
from adatracker_deploy.config.schema import Range
from adatracker_deploy.learning.change import Change
from adatracker_deploy.learning.embodiment import Embodiment
from adatracker_deploy.sim.noise import MaskNoise, NoiseLevel
from adatracker_deploy.sim.path import PathName
from adatracker_deploy.sim.task import TaskSettings
from adatracker_deploy.sim.worlds import open_world

if TYPE_CHECKING:
    from adatracker_deploy.sim.backend import WorldBackend

RATE_HZ = 10.0
"""Rate of learning and evaluation, Hz: the one at which the published policy reproduced its scores."""
MASK_SIZE = 64
"""Masks are rendered as wide as the networks' are: nothing is resampled, as at deployment with ``draw_size``
64."""


@dataclass(frozen=True, slots=True, kw_only=True)
class EpisodeSpec:
    """One episode, to the bit: equal specs give equal episodes under equal actions.

    In a level of Unreal's engine they give equal bodies, noise and speeds, but its people walk as they like.
    """

    seed: Annotated[int, Range(0, 1 << 62)]
    """Seed of the world, the body and the mask noise; see `seeds`."""
    embodiment: Embodiment = field(default_factory=Embodiment)
    scene: str = "simple_room"
    target_speed_m_s: Annotated[float, Range(0.05, 10)] = 1.0
    path: PathName = "random_walk"
    obstacles: bool = False
    others: Annotated[int, Range(0, 20)] = 0
    """Other people who walk about."""
    crossing: Annotated[int, Range(0, 20)] = 0
    """Number of the others who make for the line of sight and linger there."""
    noise: NoiseLevel = "none"
    change: Change | None = None
    """Changes of the body on the way."""
    effects: Effects = NONE
    """Fog and a rough road are in the pictures of real segmenters alone."""

    def world(self) -> WorldBackend:
        """Return the world, not stepped yet.

        Raises:
            UsageError: no such scene or path, or what simulates it is missing.
            PlatformError: the engine that simulates it fails.
        """
        return open_world(
            self.scene,
            seed=self.seed,
            target_speed_m_s=self.target_speed_m_s,
            path=self.path,
            obstacles=self.obstacles,
            others=self.others,
            crossing=self.crossing,
            effects=self.effects,
        )

    def mask_noise(self) -> MaskNoise:
        """Return this episode's mask noise."""
        return MaskNoise.of_level(self.noise, seed=self.seed)

    def task_settings(self, steps: int = 500) -> TaskSettings:
        """Return the rules: 10 Hz, masks 64 wide, this body's field of view."""
        return TaskSettings(
            rate_hz=RATE_HZ,
            steps=steps,
            mask_size=(round(MASK_SIZE * self.embodiment.aspect), MASK_SIZE),
            fov_rad=math.radians(self.embodiment.fov_deg),
        )
