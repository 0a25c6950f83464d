"""An episode in a level of Unreal's engine: the engine walks its people, the toolkit moves the robot."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import cv2
import numpy as np

from adatracker_deploy.core.errors import PlatformError, UsageError
from adatracker_deploy.core.geometry import Pose
from adatracker_deploy.core.messages import MaskClass
from adatracker_deploy.core.task import DESIRED_DISTANCE_M
from adatracker_deploy.sim.backend import truth_of
from adatracker_deploy.sim.unreal.engine import COLOURS, ROBOT, triple
from adatracker_deploy.sim.unreal.units import CM, kept, numbers, to_location, to_pose, to_rotation

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from adatracker_deploy.core.messages import ClassMask, Truth
    from adatracker_deploy.sim.path import PathName
    from adatracker_deploy.sim.unreal.engine import Engine
    from adatracker_deploy.sim.unreal.units import Triple

NAV_RADIUS_CM = 3000
"""Largest distance of a person's next goal; our choice."""
_LEVEL = (0.0, 0.0, 0.0)


class UnrealWorld:
    """A `WorldBackend`: one episode with a level's people.

    In lock-step the game is paused except for the time of each `step`, which passes by the engine's clock.
    Else it runs from the first `step` on, in its own time.

    Args:
        engine: the level.
        seed: draws where people start, if the level's settings name places.
        target_speed_m_s: how fast everybody walks.
        path: ``random_walk`` by the engine's navigation, or ``still``.
        others: how many other people walk about.
        lock_step: see above.

    Attributes:
        start: where a robot starts: on the ground, 2.5 m behind the target, facing it.

    Raises:
        UsageError: the engine's people cannot walk such a path, or the settings name too few places.
        PlatformError: the connection is lost, or the game refuses a command.
    """

    def __init__(
        self,
        engine: Engine,
        *,
        seed: int,
        target_speed_m_s: float = 1.0,
        path: PathName = "random_walk",
        others: int = 0,
        lock_step: bool = True,
    ) -> None:
        if path not in {"random_walk", "still"}:
            raise UsageError(f"path {path!r}: people in Unreal's levels walk by random_walk, or stand still")
        self._engine, self._lock_step, self._runs = engine, lock_step, False
        self._people = engine.people(others)
        self._lens: tuple[float, int, int] | None = None
        self._hit = False
        engine.do("vset /action/game/pause")
        self._place_people(np.random.default_rng(seed))
        self._lift = self._lifts()
        self._send_off(target_speed_m_s, path)
        self._foot = 0.0, 0.0, 0.0
        self._robot: Pose | None = None
        self.start = self._behind_target()
        self._observe()

    @property
    def target_xy(self) -> tuple[float, float]:
        """The target's position, m, as the engine last said it."""
        return self._foot[0], self._foot[1]

    def grounded(self, pose: Pose, radius_m: float) -> Pose:  # noqa: ARG002 -- the engine knows its bodies
        """Return the pose at which the engine has the robot's body when it is put at `pose`, on the ground.

        The height is that at which the game last left the body; `pose`'s is not used.
        """
        asked = Pose(pose.x, pose.y, self._robot_z, yaw=pose.yaw)
        location, rotation = self._lifted(asked), to_rotation(asked)
        read, turned = self._engine.triples(*_where(ROBOT), first=_put(ROBOT, location, rotation))
        there = kept(location, read), kept(rotation, turned, 360.0)
        # What nothing moved keeps its last bits, which a change of units and back would not.
        moved = there != (location, rotation)
        self._robot = to_pose(_lowered(there[0], self._lift[ROBOT]), there[1]) if moved else asked
        return self._robot

    def step(self, dt_s: float, robot: Pose | None = None) -> None:
        """Let everybody walk for `dt_s` >= 0 seconds while the robot's body is at `robot`."""
        engine = self._engine
        if robot is not None and robot != self._robot:
            engine.do(*_put(ROBOT, self._lifted(robot), to_rotation(robot)))
            self._robot = robot
        if self._lock_step and dt_s > 0:
            until_ns = engine.clock.now_ns() + round(dt_s * 1e9)
            engine.do("vset /action/game/resume")
            engine.clock.sleep_until(until_ns)
            self._observe("vset /action/game/pause")
        elif self._lock_step or self._runs:
            self._observe()
        else:
            self._runs = True
            self._observe("vset /action/game/resume")

    def render_mask(self, camera: Pose, fov_rad: float, height: int, width: int) -> ClassMask:
        """Return the class mask (height, width) of the engine's object mask; `fov_rad` is horizontal."""
        return _classes(self._look(camera, fov_rad, height, width, "object_mask")[0])

    def render(
        self, camera: Pose, fov_rad: float, height: int, width: int
    ) -> tuple[ClassMask, NDArray[np.uint8]]:
        """Return the class mask (height, width) and the engine's picture (height, width, 3), both uint8."""
        mask, picture = self._look(camera, fov_rad, height, width, "object_mask", "lit")
        return _classes(mask), picture

    picture = render

    def truth(
        self,
        mask: ClassMask,
        robot: Pose,
        camera: Pose,
        radius_m: float,  # noqa: ARG002 -- the engine's body has its own
        fov_rad: float | None = None,
    ) -> Truth:
        """Return the ground truth; collisions are the engine's, of the robot's body there."""
        return truth_of(mask, robot, camera, self._foot, fov_rad, contact="something" if self._hit else None)

    @property
    def _target(self) -> str:
        return self._people[0]

    def _behind_target(self) -> Pose:
        location, rotation = self._engine.triples(*_where(self._target))
        target = to_pose(_lowered(location, self._lift[self._target]), rotation)
        self._robot_z = target.z
        x = target.x - DESIRED_DISTANCE_M * math.cos(target.yaw)
        y = target.y - DESIRED_DISTANCE_M * math.sin(target.yaw)
        return self.grounded(Pose(x, y, target.z, yaw=target.yaw), 0.0)

    def _place_people(self, rng: np.random.Generator) -> None:
        starts = self._engine.settings.starts
        if not starts:
            self._engine.do(*(f"vbp {name} reset" for name in self._people))
            return
        if len(starts) < len(self._people):
            raise UsageError(f"{len(self._people)} people: the settings name {len(starts)} places to start")
        for name, place in zip(self._people, rng.permutation(len(starts)), strict=False):
            yaw_deg = float(rng.uniform(-180.0, 180.0))
            self._engine.do(*_put(name, starts[place], (0.0, yaw_deg, 0.0)))

    def _lifts(self) -> dict[str, float]:
        """Return how far above its feet the engine counts a body's place, cm."""
        lifts = {}
        for name in (self._target, ROBOT):
            location, _ = self._engine.triples(*_where(name))
            bounds = self._engine.text(f"vget /object/{name}/bounds").split()
            try:
                lifts[name] = location[2] - float(bounds[2])
            except (IndexError, ValueError) as error:
                raise PlatformError(f"UnrealCV: bounds of {name!r} are {bounds}") from error
        return lifts

    def _send_off(self, speed_m_s: float, path: PathName) -> None:
        engine = self._engine
        engine.do(*(f"vbp {name} set_speed {speed_m_s * CM:.3f}" for name in self._people))
        walking = self._people if path == "random_walk" else self._people[1:]
        engine.do(*(f"vbp {name} nav_random {NAV_RADIUS_CM} 1" for name in walking))
        if path == "still":  # where it stands is a goal that is reached
            here, _ = engine.triples(*_where(self._target))
            engine.do(f"vbp {self._target} nav_to_goal {numbers(here)}")

    def _observe(self, *first: str) -> None:
        """Take in what the engine says of the moment, after the commands of `first`."""
        queries = _where(self._target)[0], _where(ROBOT)[0], f"vbp {ROBOT} get_hit"
        *places, hit = self._engine.ask(*first, *queries)[len(first) :]
        target, robot = map(triple, places, queries[:2])
        foot = to_pose(_lowered(target, self._lift[self._target]), _LEVEL)
        self._foot = foot.x, foot.y, foot.z
        self._robot_z = (robot[2] - self._lift[ROBOT]) / CM
        self._hit = b"1" in hit  # as UnrealZoo reads it

    def _lifted(self, robot: Pose) -> Triple:
        x, y, z = to_location(robot)
        return x, y, z + self._lift[ROBOT]

    def _look(
        self, camera: Pose, fov_rad: float, height: int, width: int, *modes: str
    ) -> list[NDArray[np.uint8]]:
        """Return what a camera sees, RGB uint8 (height, width, 3), in each of the engine's view modes."""
        name, lens = f"/camera/{self._engine.camera}", (fov_rad, height, width)
        commands = []
        if lens != self._lens:
            commands += [f"vset {name}/size {width} {height}"]
            commands += [f"vset {name}/fov {math.degrees(fov_rad):.12f}"]
            self._lens = lens
        commands += [f"vset {name}/location {numbers(to_location(camera))}"]
        commands += [f"vset {name}/rotation {numbers(to_rotation(camera))}"]
        answers = self._engine.ask(*commands, *(f"vget {name}/{mode} png" for mode in modes))
        return [_decoded(answer, height, width) for answer in answers[len(commands) :]]


def _where(name: str) -> tuple[str, str]:
    return f"vget /object/{name}/location", f"vget /object/{name}/rotation"


def _put(name: str, location: Triple, rotation: Triple) -> tuple[str, str]:
    return (
        f"vset /object/{name}/location {numbers(location)}",
        f"vset /object/{name}/rotation {numbers(rotation)}",
    )


def _lowered(location: Triple, lift_cm: float) -> Triple:
    return location[0], location[1], location[2] - lift_cm


def _decoded(png: bytes, height: int, width: int) -> NDArray[np.uint8]:
    image = cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_COLOR)
    if image is None or image.shape != (height, width, 3):
        got = "no picture" if image is None else f"a picture of {image.shape[1]}x{image.shape[0]} px"
        raise PlatformError(f"UnrealCV: {got}, asked for {width}x{height}")
    return np.ascontiguousarray(image[:, :, ::-1])


def _classes(colours: NDArray[np.uint8]) -> ClassMask:
    """Return the class of each pixel of an object mask: the nearest of `COLOURS`."""
    palette = np.array([COLOURS[kind] for kind in MaskClass], np.int32)
    apart = ((colours[:, :, None, :].astype(np.int32) - palette) ** 2).sum(axis=3)
    classes: ClassMask = apart.argmin(axis=2).astype(np.uint8)
    return classes
