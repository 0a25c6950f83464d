"""The conditions under which policies are compared, and the paper's grid of bodies.

A cell is a condition, a camera height and a target's speed; its seed draws the rest. The tracker's limit is
1.3 times the target's speed and at least 1 m/s, forward and backward; it turns at most 120 degrees a second
(`wide` scales all three).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from adatracker_deploy.config.effects import NONE, Effects
from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.learning.change import Change
from adatracker_deploy.learning.embodiment import Embodiment
from adatracker_deploy.learning.episode_spec import EpisodeSpec
from adatracker_deploy.learning.view import pitch_in_view_deg
from adatracker_deploy.sim.noise import NoiseLevel
from adatracker_deploy.sim.path import PathName

HEIGHTS_M = (0.3, 1.0, 1.7, 3.0)
TARGET_SPEEDS_M_S = (0.5, 1.0, 2.0, 3.0)
"""The paper's 16 embodiments are these heights by these speeds (its table of per-embodiment results)."""

_STEPS = 500
"""The horizon amid which a body changes; a shorter one may end before."""

YAW_RATE_RAD_S = math.radians(120.0)

ConditionName = Literal["clean", "field", "hard", "wide", "rough"]
Interval = tuple[float, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class Condition:
    """Settings of an episode besides the cell's height and speed; intervals are sampled uniformly."""

    name: ConditionName
    description: str
    path: PathName = "random_walk"
    obstacles: bool = False
    others: int = 0
    crossing: int = 0
    noise: NoiseLevel = "none"
    pitch_deg: Interval = (0.0, 0.0)
    """Moved as little as is needed to have the target in view at the start."""
    fov_deg: Interval = (90.0, 90.0)
    lag_s: Interval = (0.0, 0.0)
    delay_steps: tuple[int, int] = (0, 0)
    yaw_rate_scale: Interval = (1.0, 1.0)
    """On 120 degrees a second."""
    forward_scale: Interval = (1.0, 1.0)
    """On the cell's limit."""
    backward_share: Interval = (1.0, 1.0)
    """The limit backward, as a share of that forward."""
    changes: bool = False
    """The body changes amid every episode (`change.Change`)."""
    effects: Effects = NONE


_FIELD = Condition(
    name="field",
    description="obstacles, two other people, lag, delay, tilted cameras, augmented masks",
    obstacles=True,
    others=2,
    noise="field",
    pitch_deg=(-5.0, 15.0),
    fov_deg=(70.0, 100.0),
    lag_s=(0.1, 0.4),
    delay_steps=(0, 2),
)
CONDITIONS: dict[str, Condition] = {
    condition.name: condition
    for condition in (
        Condition(name="clean", description="an empty room, perfect masks, a body that obeys at once"),
        _FIELD,
        Condition(
            name="hard",
            description="U-turns, people who stand in the way, long occlusions, bodies beyond the training's",
            path="u_turns",
            obstacles=True,
            others=4,
            crossing=2,
            noise="hard",
            pitch_deg=(-20.0, 40.0),
            fov_deg=(50.0, 120.0),
            lag_s=(0.4, 0.7),
            delay_steps=(1, 4),
            yaw_rate_scale=(0.75, 1.5),
        ),
        Condition(
            name="wide",
            description="the field's world; bodies that obey late and unevenly, and change on the way",
            obstacles=True,
            others=2,
            noise="field",
            pitch_deg=(-20.0, 40.0),
            fov_deg=(60.0, 120.0),
            lag_s=(0.0, 1.0),
            delay_steps=(0, 6),
            yaw_rate_scale=(0.5, 2.0),
            forward_scale=(1.0, 2.0),
            backward_share=(0.3, 1.0),
            changes=True,
        ),
        replace(
            _FIELD,
            name="rough",
            description="the field in fog, on a bad road that shakes the camera, with people who sit down",
            effects=Effects(fog_m=40.0, road="C", sit=True),
        ),
    )
}


def condition_named(name: str) -> Condition:
    """Return a condition.

    Raises:
        UsageError: no such name.
    """
    if name not in CONDITIONS:
        raise UsageError(f"unknown condition {name!r}: known are {', '.join(CONDITIONS)}")
    return CONDITIONS[name]


def make_cell(
    condition: Condition | str,
    height_m: float,
    target_speed_m_s: float,
    seed: int,
    *,
    scene: str = "simple_room",
    aspect: float = 1.0,
) -> EpisodeSpec:
    """Return one episode of a cell; every policy that is given the same seed meets the same episode.

    Args:
        condition: one, or its name.
        height_m: of the camera.
        target_speed_m_s: of everybody in the world.
        seed: see `seeds` for which to use.
        scene: its name.
        aspect: of the pictures, see `Embodiment`; the pitch follows from it.

    Raises:
        UsageError: there is no such condition.
    """
    if isinstance(condition, str):
        condition = condition_named(condition)
    rng = np.random.default_rng([seed, 0xCE11])
    fov_deg = float(rng.uniform(*condition.fov_deg))
    low, high = condition.delay_steps
    embodiment = Embodiment(
        height_m=height_m,
        pitch_deg=pitch_in_view_deg(float(rng.uniform(*condition.pitch_deg)), height_m, fov_deg, aspect),
        fov_deg=fov_deg,
        aspect=aspect,
        forward_m_s=max(1.0, 1.3 * target_speed_m_s),
        yaw_rate_rad_s=YAW_RATE_RAD_S * float(rng.uniform(*condition.yaw_rate_scale)),
        lag_s=float(rng.uniform(*condition.lag_s)),
        delay_s=int(rng.integers(low, high + 1)) / 10,
    )
    forward_m_s = embodiment.forward_m_s * float(rng.uniform(*condition.forward_scale))
    backward_m_s = forward_m_s * float(rng.uniform(*condition.backward_share))
    return EpisodeSpec(
        seed=seed,
        embodiment=replace(embodiment, forward_m_s=forward_m_s, backward_m_s=backward_m_s),
        scene=scene,
        target_speed_m_s=target_speed_m_s,
        path=condition.path,
        obstacles=condition.obstacles,
        others=condition.others,
        crossing=condition.crossing,
        noise=condition.noise,
        change=Change.drawn(rng, _STEPS) if condition.changes else None,
        effects=condition.effects,
    )


def random_cell(condition: Condition | str, seed: int) -> EpisodeSpec:
    """Return an episode of one of the paper's 16 bodies, which the seed picks."""
    rng = np.random.default_rng([seed, 0x16])
    return make_cell(condition, float(rng.choice(HEIGHTS_M)), float(rng.choice(TARGET_SPEEDS_M_S)), seed)
