"""The task as Gymnasium environments, which `adatracker_deploy.gym` registers (needs the train extra).

`AdaTracker-v0` draws its episodes from the deploy recipe; `AdaTrackerClean-v0`, `AdaTrackerField-v0`,
`AdaTrackerHard-v0` and `AdaTrackerWide-v0` from the paper's 16 bodies under that condition. `reset(seed=...)`
takes the seed of the episode itself (see `seeds`), later resets without one draw training seeds.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any, Literal
from urllib.parse import urlencode

import gymnasium
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from adatracker_deploy.core.camera import UNREAL
from adatracker_deploy.core.messages import Truth
from adatracker_deploy.core.task import SIMULATOR_LEAST_REWARD, SIMULATOR_LOST_STEPS
from adatracker_deploy.learning.conditions import condition_named, make_cell, random_cell
from adatracker_deploy.learning.data.recipe import load_recipe
from adatracker_deploy.learning.episode_spec import MASK_SIZE, EpisodeSpec
from adatracker_deploy.learning.seeds import TRAINING
from adatracker_deploy.learning.tracking import Tracking
from adatracker_deploy.policy.drawing import squared
from adatracker_deploy.sim.worlds import check_scene

Observed = NDArray[np.uint8]
Rules = Literal["paper", "simulator"]


class TrackingEnv(gymnasium.Env[Observed, NDArray[np.float32]]):
    """Tracking episodes: observations are class masks, actions are fractions of the body's limits.

    The observation is a class mask, uint8 (64, 64), or an RGB image, uint8 (64, 64, 3), which is never
    augmented by noise. The action is float32 (2,) in [-1, 1]: forward, and yaw with counter-clockwise
    positive, in the order and with the signs of AdaTracker's bundles. A lost target terminates, the horizon
    truncates. `info` holds the truth of the moment and what the policy is to find out about the body.

    Args:
        condition: draw cells of this condition.
        recipe: draw episodes of this recipe, by name or path; used when no condition is given.
        scene: of every episode, instead of what they would draw: a name, or an engine's level.
        height_m: of every episode's camera; only with a condition and a target's speed.
        target_speed_m_s: of every episode; only with a condition and a height.
        observe: what is observed.
        rules: the paper's, or those of the published simulator where it differs.
        steps: the horizon.
        render_mode: `rgb_array` or nothing.

    Raises:
        UsageError: no such condition, recipe or scene.
    """

    metadata: dict[str, Any] = {"render_modes": ["rgb_array"], "render_fps": 10}  # noqa: RUF012 -- as Gymnasium has it

    def __init__(
        self,
        *,
        condition: str | None = None,
        recipe: str = "deploy",
        scene: str | None = None,
        height_m: float | None = None,
        target_speed_m_s: float | None = None,
        observe: Literal["mask", "rgb"] = "mask",
        rules: Rules = "paper",
        steps: int = 500,
        render_mode: str | None = None,
    ) -> None:
        self._condition = condition_named(condition) if condition else None
        self._recipe = None if condition else load_recipe(recipe)
        if scene is not None:
            check_scene(scene)
        self._scene = scene
        self._cell = (height_m, target_speed_m_s)
        self._observe = observe
        self._rules = rules
        self._steps = steps
        self.render_mode = render_mode
        if observe == "mask":
            self.observation_space = spaces.Box(0, 3, (MASK_SIZE, MASK_SIZE), np.uint8)
        else:
            self.observation_space = spaces.Box(0, 255, (MASK_SIZE, MASK_SIZE, 3), np.uint8)
        self.action_space = spaces.Box(-1.0, 1.0, (2,), np.float32)
        self.tracking: Tracking | None = None

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observed, dict[str, Any]]:
        """Begin the episode of a seed; `options` may give a whole `EpisodeSpec` as `spec`."""
        super().reset(seed=seed)
        episode_seed = seed if seed is not None else int(self.np_random.integers(len(TRAINING)))
        spec: EpisodeSpec = (options or {}).get("spec") or self._draw(episode_seed)
        if self._scene is not None:
            spec = replace(spec, scene=self._scene)
        settings = spec.task_settings(self._steps)
        if self._rules == "simulator":
            settings = replace(
                settings, max_lost_steps=SIMULATOR_LOST_STEPS, least_reward=SIMULATOR_LEAST_REWARD
            )
        self.tracking = Tracking(spec, settings)
        seen = self.tracking.begin()
        world, body = self.tracking.task.world, self.tracking.task.body
        truth = world.truth(seen.mask, body.pose, body.camera_pose, settings.body_radius_m)
        return self._observed(seen.mask), self._info(truth, visible=True, dropped=False)

    def step(self, action: NDArray[np.float32]) -> tuple[Observed, float, bool, bool, dict[str, Any]]:
        """Follow an action for 0.1 s."""
        if self.tracking is None:
            raise gymnasium.error.ResetNeeded("call reset before step")
        tick = self.tracking.step(action)
        info = self._info(tick.truth, visible=tick.visible, dropped=tick.dropped)
        observed = self._observed(tick.observation.mask)
        return observed, tick.reward, tick.end == "lost", tick.end == "completed", info

    def render(self) -> NDArray[np.uint8]:
        """Return what the body's camera sees, RGB uint8 (256, 256, 3)."""
        return self._image(256)

    def _draw(self, seed: int) -> EpisodeSpec:
        if self._recipe is not None:
            return self._recipe.draw(seed)
        assert self._condition is not None
        height_m, target_speed_m_s = self._cell
        if height_m is None or target_speed_m_s is None:
            return random_cell(self._condition, seed)
        return make_cell(self._condition, height_m, target_speed_m_s, seed)

    def _observed(self, mask: Observed) -> Observed:
        return squared(mask) if self._observe == "mask" else self._image(MASK_SIZE)

    def _image(self, size: int) -> NDArray[np.uint8]:
        if self.tracking is None:
            raise gymnasium.error.ResetNeeded("call reset before render")
        task = self.tracking.task
        return task.world.render(task.body.camera_pose, task.settings.fov_rad, size, size)[1]

    def _info(self, truth: Truth, *, visible: bool, dropped: bool) -> dict[str, Any]:
        assert self.tracking is not None
        body = self.tracking.embodiment
        return {
            "distance_m": truth.distance_m,
            "bearing_rad": truth.bearing_rad,
            "collided": truth.contact is not None,
            "visible": visible,
            "dropped": dropped,
            "height_m": body.height_m,
            "pitch_rad": math.radians(body.pitch_deg),
            "fov_rad": math.radians(body.fov_deg),
            "forward_m_s": body.forward_m_s,
            "backward_m_s": body.backward_m_s,
            "yaw_rate_rad_s": body.yaw_rate_rad_s,
            "lag_s": body.lag_s,
            "delay_s": body.delay_s,
        }


def unreal_env(
    *, level: str, server: str = "127.0.0.1:9000", settings: str = "", condition: str = "clean", **kwargs: Any
) -> TrackingEnv:
    """Return the environment of an UnrealCV server's level.

    Args:
        level: the map's name.
        server: its HOST:PORT; 9000 is UnrealCV's own port.
        settings: UnrealZoo's setting file of the map; empty for none.
        condition: ``clean`` or ``field``: an engine's people do not walk as ``hard`` has it.
        **kwargs: the others of `TrackingEnv`.

    Raises:
        UsageError: see `TrackingEnv`.
    """
    query = f"?{urlencode({'settings': settings})}" if settings else ""
    return TrackingEnv(condition=condition, scene=f"{UNREAL}{server}/{level}{query}", **kwargs)
