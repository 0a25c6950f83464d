"""A virtual camera in a world: the people who walk in it, and the pictures that are taken of them."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from adatracker_deploy.core.camera import is_unreal
from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.core.geometry import Pose, wrap_angle
from adatracker_deploy.core.messages import Shot
from adatracker_deploy.sim.anchor import Anchor
from adatracker_deploy.sim.render.lens import Lens, bend, encode, expose, wider
from adatracker_deploy.sim.road import Road
from adatracker_deploy.sim.worlds import open_world

if TYPE_CHECKING:
    from adatracker_deploy.config.effects import RoadClass
    from adatracker_deploy.platform import Scenario
    from adatracker_deploy.sim.backend import WorldBackend

BODY_RADIUS_M = 0.3
"""Radius of a robot's body: within it an obstacle counts as a collision."""


class View(NamedTuple):
    """The input of a camera at one moment."""

    t_ns: int
    robot: Pose
    camera: Pose
    going: bool
    """Whether the people walk; before that they stand still."""


class Eye:
    """A camera in a world: takes pictures, as its lens shows them, and the truth of the same pixels.

    Args:
        world: drawn, and never stepped here.
        fov_rad: the camera's horizontal field of view.
        size: width and height of the pictures, px.
        lens: the camera's faults.
        seed: of the noise.
        road: shakes the camera.

    Raises:
        UsageError: what draws is not installed.
    """

    def __init__(
        self,
        world: WorldBackend,
        fov_rad: float,
        size: tuple[int, int] = (640, 480),
        lens: Lens = Lens(),  # noqa: B008 -- frozen
        *,
        seed: int = 0,
        road: RoadClass = "smooth",
    ) -> None:
        self._road = Road(road, seed)
        self._world, self._fov_rad, self._size, self._lens = world, fov_rad, size, lens
        self._rng = np.random.default_rng(seed)
        self._last: tuple[int, Pose] | None = None

    def take(self, t_ns: int, seq: int, robot: Pose, camera: Pose) -> Shot:
        """Return the picture that a camera at this pose takes; poses are in the world."""
        camera = self._road.tilted(camera, robot)
        width, height = self._size
        lens, fov_rad = self._lens, self._fov_rad
        mask, picture = self._world.picture(camera, wider(fov_rad, lens, height, width), height, width)
        mask = bend(mask, lens, fov_rad, nearest=True)
        rgb = expose(bend(picture, lens, fov_rad), lens, self._across(t_ns, camera), self._rng)
        truth = self._world.truth(mask, robot, camera, BODY_RADIUS_M, fov_rad)
        return Shot(encode(rgb, lens), t_ns, seq, truth)

    def _across(self, t_ns: int, camera: Pose) -> tuple[float, float]:
        """Return how fast a turning camera's picture moves across its sensor, px/s, right and down."""
        last, self._last = self._last, (t_ns, camera)
        if last is None or t_ns <= last[0]:
            return 0.0, 0.0
        seconds, before = (t_ns - last[0]) / 1e9, last[1]
        focal_px = self._size[0] / 2 / math.tan(self._fov_rad / 2)
        yaw = wrap_angle(camera.yaw - before.yaw)
        pitch = wrap_angle(camera.pitch - before.pitch)
        return focal_px * yaw / seconds, -focal_px * pitch / seconds


class Studio:
    """The people of a world and the camera.

    Args:
        scenario: which world.
        fov_rad: the camera's horizontal field of view.
        own_frame: the views' poses are in the robot's own frame, above ground, and not in the world's; where
            the first one is taken is the world's start.

    Raises:
        UsageError: no such scene, or what draws it is not installed.
    """

    def __init__(
        self,
        scenario: Scenario,
        fov_rad: float,
        *,
        own_frame: bool = False,
    ) -> None:
        self._world = world_of(scenario)
        self._eye = Eye(
            self._world, fov_rad, scenario.picture_size, seed=scenario.seed, road=scenario.effects.road
        )
        self._own_frame = own_frame
        self._anchor: Anchor | None = None
        self._last: View | None = None
        self._seq = 0

    def take(self, view: View) -> Shot:
        """Let the people walk until the view's time, and take a picture."""
        view, last = self._in_world(view), self._last
        if view.going and last is not None and last.going:
            self._world.step((view.t_ns - last.t_ns) / 1e9, view.robot)
        self._last = view
        self._seq += 1
        return self._eye.take(view.t_ns, self._seq, view.robot, view.camera)

    def _in_world(self, view: View) -> View:
        if not self._own_frame:
            return view
        if self._anchor is None:
            self._anchor = Anchor.between(view.robot, self._world.start)
        to_world = self._anchor.to_world
        return view._replace(robot=to_world(view.robot), camera=to_world(view.camera))


def world_of(scenario: Scenario) -> WorldBackend:
    """Return a scenario's world; an engine's runs in its own time.

    Raises:
        UsageError: no such scene, or what simulates it is missing or cannot do this.
        PlatformError: the engine fails.
    """
    unreal = is_unreal(scenario.scene)
    if unreal and scenario.person:
        raise UsageError("the people of Unreal's levels have their own looks: drop --person")
    return open_world(
        scenario.scene,
        seed=scenario.seed,
        target_speed_m_s=scenario.target_speed_m_s,
        path="random_walk" if unreal else "s_path",
        others=scenario.others,
        cast=[Path(scenario.person)] if scenario.person else (),
        effects=scenario.effects,
        lock_step=False,
    )
