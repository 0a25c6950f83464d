"""The world: one scene and its people, with rendering, collisions and ground truth."""

from __future__ import annotations

import importlib.util
import math
from typing import TYPE_CHECKING, get_args

import numpy as np
from numpy.typing import NDArray

from adatracker_deploy.config.effects import NONE, Effects
from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.core.geometry import Pose
from adatracker_deploy.core.task import DESIRED_DISTANCE_M
from adatracker_deploy.sim.backend import truth_of
from adatracker_deploy.sim.camera import Camera
from adatracker_deploy.sim.footprint import Clearance, Points
from adatracker_deploy.sim.path import (
    BERTH_M,
    Crosser,
    PathName,
    RandomWalk,
    SPath,
    Still,
    UTurnWalk,
    Walker,
    lap_course,
)
from adatracker_deploy.sim.person import HEIGHT_M, Gait
from adatracker_deploy.sim.rest import Rest
from adatracker_deploy.sim.scenes import build_scene, scene_names
from adatracker_deploy.sim.stage import Stage

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from adatracker_deploy.core.messages import ClassMask, Contact, Truth
    from adatracker_deploy.sim.render.renderer import Renderer

PERSON_RADIUS_M = 0.3
"""Half the width of a person, for collisions and for keeping apart."""

HEADROOM_M = 0.5
"""Height above people's heads below which they avoid a robot; more than any body's radius in `contact`."""

_STRIDE_S = 0.1
"""Longest interval between people's decisions where to walk, however rarely the world is stepped."""


def check_scene(name: str) -> None:
    """Check, before anything moves, that a world of this name can be built.

    Raises:
        UsageError: no scene has this name, or MuJoCo is not installed.
    """
    if name not in scene_names():
        raise UsageError(f"unknown scene {name!r}: known are {', '.join(scene_names())}")
    if importlib.util.find_spec("mujoco") is None:
        raise UsageError("a simulated world needs mujoco: pip install 'adatracker-deploy[world]'")


class World:
    """A scene with a target person and others; the same seed and the same calls give the same world.

    Args:
        scene: its name, see `scene_names`.
        seed: seeds the layout, the people's paths and their starting points.
        target_speed_m_s: how fast everybody walks.
        path: the target's path; others always walk at random.
        obstacles: whether the arena has obstacles. Its walls and surroundings are always there.
        others: how many other people walk about.
        crossing: how many of the others cross the robot's line of sight and linger there.
        cast: glTF files of who plays whom in `picture`, the target first; the rest are drawn from those that
            ship.
        effects: fog, and whether people sit down.

    Attributes:
        start: where a robot starts: on the ground, 2.5 m behind the target, facing it.

    Raises:
        UsageError: no such scene or path, or MuJoCo is not installed.
    """

    def __init__(
        self,
        scene: str,
        *,
        seed: int,
        target_speed_m_s: float = 1.0,
        path: PathName = "s_path",
        obstacles: bool = True,
        others: int = 0,
        crossing: int = 0,
        cast: Sequence[Path] = (),
        effects: Effects = NONE,
    ) -> None:
        check_scene(scene)
        if path not in get_args(PathName):
            raise UsageError(f"unknown path {path!r}: known are {', '.join(get_args(PathName))}")
        layout, target, crowd, rests = map(np.random.default_rng, np.random.SeedSequence(seed).spawn(4))
        self.scene = build_scene(scene, layout)
        self._space = self.scene.free_space(obstacles=obstacles)
        self._walkable = self.scene.free_space(obstacles=obstacles, inset_m=self.scene.margin_m)
        self._stage = Stage(self.scene, obstacles=obstacles, people=1 + others)
        self._camera = Camera(self.scene, self._stage)
        self._walkers = [self._target(path, target, target_speed_m_s)]
        self.start = self._behind(self._walkers[0])
        for index, rng in enumerate(crowd.spawn(others)):
            kind = Crosser if index < crossing else RandomWalk
            self._walkers.append(
                self._wanderer(kind, rng, target_speed_m_s, self._room(self.start, skip=None))
            )
        self._gaits = [Gait() for _ in self._walkers]
        self._rests = [Rest(rng) for rng in rests.spawn(1 + others)] if effects.sit else []
        self._obstacles, self._seed, self._t_s, self._cast = obstacles, seed, 0.0, tuple(cast)
        self._effects = effects
        self._renderer: Renderer | None = None
        self._staged = self._posed = False

    @property
    def target_xy(self) -> tuple[float, float]:
        """The target's position, m."""
        return self._walkers[0].x, self._walkers[0].y

    @property
    def people_xy(self) -> NDArray[np.float64]:
        """Everybody's position, the target first, shape (1 + others, 2), m."""
        return np.array([(walker.x, walker.y) for walker in self._walkers])

    def ground_z(self, x: float, y: float) -> float:
        """Return the height of the ground, m."""
        return self.scene.terrain.height(x, y)

    def step(self, dt_s: float, robot: Pose | None = None) -> None:
        """Let everybody walk for `dt_s` >= 0 seconds, avoiding a robot at `robot` unless it is overhead."""
        strides = math.ceil(dt_s / _STRIDE_S - 1e-9)
        self._t_s += dt_s
        for _ in range(strides):
            self._stride(dt_s / strides, robot)
            self._staged = self._posed = False

    def render(
        self, camera: Pose, fov_rad: float, height: int, width: int
    ) -> tuple[ClassMask, NDArray[np.uint8]]:
        """Return the class mask (height, width) and the RGB image (height, width, 3), both uint8.

        Args:
            camera: its pose, x along the optical axis.
            fov_rad: horizontal field of view; pixels are square.
            height: rows, px.
            width: columns, px.
        """
        self._stage_people()
        return self._camera.image(camera, fov_rad, height, width)

    def render_mask(self, camera: Pose, fov_rad: float, height: int, width: int) -> ClassMask:
        """Return the class mask alone, equal to `render`'s."""
        self._stage_people()
        return self._camera.mask(camera, fov_rad, height, width)

    def picture(
        self, camera: Pose, fov_rad: float, height: int, width: int
    ) -> tuple[ClassMask, NDArray[np.uint8]]:
        """Return the class mask (height, width) and a picture (height, width, 3) for a real detector.

        The people in it wear clothes and are of different heights, so its mask differs from `render`'s. Takes
        the same arguments.

        Raises:
            UsageError: Panda3D is not installed, or there are no people.
        """
        if self._renderer is None:
            self._renderer = self._rendered()
        self._pose_people(self._renderer)
        return self._renderer.draw(camera, fov_rad, height, width)

    def contact(self, x: float, y: float, z: float, radius_m: float) -> Contact | None:
        """Return what a sphere at this point touches: an obstacle, which may be a wall, or a person."""
        if self._space.touches(x, y, z, radius_m):
            return "an obstacle"
        people = self.people_xy
        across = np.hypot(people[:, 0] - x, people[:, 1] - y) - PERSON_RADIUS_M
        for index, (gap, (px, py)) in enumerate(zip(across.tolist(), people.tolist(), strict=True)):
            foot = self.ground_z(px, py)
            above = max(foot - z, z - foot - HEIGHT_M, 0.0)
            if math.hypot(max(gap, 0.0), above) < radius_m:
                return "another person" if index else "the target"
        return None

    def grounded(self, pose: Pose, radius_m: float) -> Pose:
        """Return the pose at which a ground body heading for `pose` ends up.

        A disc of `radius_m` is kept out of obstacles and walls, and follows the ground's slope.
        """
        x, y = self._space.push_out(pose.x, pose.y, radius_m)
        roll, pitch = self.scene.terrain.slope(x, y, pose.yaw)
        return Pose(x, y, self.ground_z(x, y), roll, pitch, pose.yaw)

    def truth(
        self, mask: ClassMask, robot: Pose, camera: Pose, radius_m: float, fov_rad: float | None = None
    ) -> Truth:
        """Return the ground truth for the moment at which `mask` was rendered.

        Args:
            mask: shape (H, W).
            robot: the body's pose.
            camera: the camera's.
            radius_m: of the body, for collisions.
            fov_rad: the mask's horizontal field of view; without one, the target is taken to be in view.
        """
        x, y = self.target_xy
        contact = self.contact(robot.x, robot.y, robot.z, radius_m)
        return truth_of(mask, robot, camera, (x, y, self.ground_z(x, y)), fov_rad, contact=contact)

    def _stride(self, dt_s: float, robot: Pose | None) -> None:
        for index, (walker, gait) in enumerate(zip(self._walkers, self._gaits, strict=True)):
            x, y = walker.x, walker.y
            if self._rests:
                rest = self._rests[index]
                rest.step(dt_s)
                gait.seated = rest.seated
                if not rest.walking:
                    gait.walk(0.0, dt_s)
                    continue
            if isinstance(walker, Crosser) and robot is not None:
                walker.meet((robot.x, robot.y), self.target_xy, dt_s)
            walker.step(dt_s, self._room(robot, skip=index))
            gait.walk(math.dist((x, y), (walker.x, walker.y)), dt_s)

    def _stage_people(self) -> None:
        """Place everybody for the ray caster, unless they are; only who is looked at costs time."""
        if not self._staged:
            for index, (walker, gait) in enumerate(zip(self._walkers, self._gaits, strict=True)):
                self._stage.move_person(index, self._foot(walker), walker.heading, gait)
            self._staged = True

    def _pose_people(self, renderer: Renderer) -> None:
        """Place everybody for pictures, unless they are."""
        if not self._posed:
            for index, (walker, gait) in enumerate(zip(self._walkers, self._gaits, strict=True)):
                renderer.place(index, self._foot(walker), walker.heading, gait, self._t_s)
            self._posed = True

    def _foot(self, walker: Walker) -> tuple[float, float, float]:
        return walker.x, walker.y, self.ground_z(walker.x, walker.y)

    def _rendered(self) -> Renderer:
        """Return the renderer of this world; who plays whom and the hour follow from the seed."""
        from adatracker_deploy.sim.render.figure import shipped_people
        from adatracker_deploy.sim.render.nodes import Daylight
        from adatracker_deploy.sim.render.renderer import Renderer

        rng = np.random.default_rng([self._seed, 1])
        shipped = shipped_people()
        people = [shipped[at] for at in rng.permutation(len(shipped))]
        people = [*self._cast, *(path for path in people if path not in self._cast)]
        daylight = Daylight(
            sun_deg=float(rng.uniform(20.0, 65.0)),
            azimuth_deg=float(rng.uniform(-180.0, 180.0)),
            cloudy=float(rng.uniform(0.0, 0.8)),
            fog_m=self._effects.fog_m,
        )
        return Renderer(
            self.scene,
            obstacles=self._obstacles,
            people=[people[at % len(people)] for at in range(len(self._walkers))],
            daylight=daylight,
            seed=self._seed,
        )

    def _room(self, robot: Pose | None, *, skip: int | None) -> Clearance:
        """Return the clearance of a person who avoids obstacles, the robot and everybody else."""
        bodies = [(walker.x, walker.y) for index, walker in enumerate(self._walkers) if index != skip]
        if robot is not None and robot.z < self.ground_z(robot.x, robot.y) + HEIGHT_M + HEADROOM_M:
            bodies.append((robot.x, robot.y))
        if not bodies:
            return self._walkable.clearance
        centres = np.array(bodies)

        def clearance(points: Points) -> NDArray[np.float64]:
            apart = np.hypot(*(points[:, None, :] - centres).transpose(2, 0, 1)).min(axis=1) - PERSON_RADIUS_M
            clear: NDArray[np.float64] = np.minimum(self._walkable.clearance(points), apart)
            return clear

        return clearance

    def _target(self, path: PathName, rng: np.random.Generator, speed_m_s: float) -> Walker:
        if path == "s_path":
            course = lap_course(self.scene.lap)
            if rng.random() < 0.5:
                course = course[::-1]
            return SPath(course, speed_m_s, rng.uniform(0.0, 1e3))
        kind = UTurnWalk if path == "u_turns" else RandomWalk
        walker = self._wanderer(kind, rng, speed_m_s, self._walkable.clearance)
        return Still(walker.x, walker.y, walker.heading) if path == "still" else walker

    def _wanderer(
        self, kind: type[RandomWalk], rng: np.random.Generator, speed_m_s: float, room: Clearance
    ) -> RandomWalk:
        """Return a walker at a random free point, with room for a robot behind."""
        half = np.array([self.scene.half_x_m, self.scene.half_y_m]) - self.scene.margin_m
        behind = np.linspace(0.0, DESIRED_DISTANCE_M, 6)[:, None]
        while True:
            place, heading = rng.uniform(-half, half), rng.uniform(-math.pi, math.pi)
            way = place - behind * np.array([math.cos(heading), math.sin(heading)])
            if (room(way) >= BERTH_M).all():
                x, y = place.tolist()
                return kind(x, y, heading, speed_m_s=speed_m_s, rng=rng)

    def _behind(self, walker: Walker) -> Pose:
        x = walker.x - DESIRED_DISTANCE_M * math.cos(walker.heading)
        y = walker.y - DESIRED_DISTANCE_M * math.sin(walker.heading)
        return self.grounded(Pose(x, y, yaw=walker.heading), PERSON_RADIUS_M)
