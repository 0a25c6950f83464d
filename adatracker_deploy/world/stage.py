"""A scene with its people as a MuJoCo model: the one module that knows the simulator.

MuJoCo serves as a ray caster only; no dynamics are stepped. Each limb of a person is a mocap body of its own:
`mj_multiRay` passes over bodies by their bounding boxes, so geoms must stay where their bodies are.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from adatracker_deploy.messages import MaskClass
from adatracker_deploy.world.person import LIMBS, REACH_M, Gait, Role, posture
from adatracker_deploy.world.scene import Rgb, Scene

SOLID, SURFACE = 0, 1
"""MuJoCo geom groups: what can hide something and is not background, and the ground and walls."""

WALL_THICKNESS_M = 0.2

_SKIN_AND_HAIR: tuple[tuple[Rgb, Rgb], ...] = (
    ((0.86, 0.66, 0.53), (0.20, 0.13, 0.08)),
    ((0.55, 0.38, 0.28), (0.07, 0.06, 0.06)),
    ((0.93, 0.76, 0.64), (0.62, 0.45, 0.22)),
)
_CLOTHES: tuple[tuple[Rgb, Rgb], ...] = (
    ((0.80, 0.13, 0.12), (0.13, 0.18, 0.36)),
    ((0.13, 0.42, 0.66), (0.30, 0.27, 0.24)),
    ((0.92, 0.75, 0.22), (0.16, 0.16, 0.17)),
    ((0.24, 0.52, 0.30), (0.45, 0.38, 0.28)),
    ((0.88, 0.88, 0.86), (0.40, 0.14, 0.16)),
)


class Stage:
    """What can be seen, and of what class and colour it is.

    Attributes:
        class_of_geom: uint8 (geoms + 1,); the last one, index -1, is for rays that meet nothing.
        rgb_of_geom: float32 (geoms + 1, 3).
        windows_of_geom: bool (geoms + 1,), which sides have rows of windows.
        ground_geom: the ground's index.
    """

    def __init__(self, scene: Scene, *, obstacles: bool, people: int) -> None:
        """Build `scene` with this many people, the first of whom is the target, all at the origin.

        Raises:
            ImportError: MuJoCo is not installed.
        """
        import mujoco

        self._mujoco = mujoco
        self._things = scene.everything(obstacles=obstacles)
        self._windows: dict[str, bool] = {}
        spec = mujoco.MjSpec()
        self._add_surfaces(spec, scene)
        classes = {"world": MaskClass.BACKGROUND}
        for index in range(len(self._things)):
            classes[f"thing {index}"] = MaskClass.OBSTACLE
            self._add_thing(spec, scene, index)
        for index in range(people):
            for body in self._add_person(spec, index):
                classes[body] = MaskClass.TARGET if index == 0 else MaskClass.PERSON
        model = self._model = spec.compile()
        data = self._data = mujoco.MjData(model)
        mujoco.mj_kinematics(model, data)

        # MuJoCo numbers the geoms of the world body first, whatever the order they were added in: what a geom
        # is follows from its body alone.
        class_of_body = np.array([classes[model.body(i).name] for i in range(model.nbody)], np.uint8)
        self.class_of_geom = np.append(class_of_body[model.geom_bodyid], np.uint8(MaskClass.BACKGROUND))
        self.rgb_of_geom = np.vstack([model.geom_rgba[:, :3], np.zeros(3)]).astype(np.float32)
        windows = [self._windows.get(model.geom(i).name, False) for i in range(model.ngeom)]
        self.windows_of_geom = np.array([*windows, False])
        self.ground_geom = int(model.geom("ground").id)
        # Mocap bodies are numbered in the order they were added in.
        self._mocap_pos = data.mocap_pos.reshape(people, len(LIMBS), 3)
        self._mocap_quat = data.mocap_quat.reshape(people, len(LIMBS), 4)
        self._ball_centres, self._ball_radii = self._balls(people)

    def move_person(self, index: int, foot: tuple[float, float, float], heading: float, gait: Gait) -> None:
        """Put a person's feet on a place of the scene, turned to `heading` (rad); seen so after `settle`."""
        centres, pitches = posture(gait)
        cos, sin = math.cos(heading), math.sin(heading)
        place = self._mocap_pos[index]
        place[:, 0] = foot[0] + cos * centres[:, 0] - sin * centres[:, 1]
        place[:, 1] = foot[1] + sin * centres[:, 0] + cos * centres[:, 1]
        place[:, 2] = foot[2] + centres[:, 2]
        # The quaternion product of a yaw by `heading` and a pitch by `pitches`.
        yaw_w, yaw_z = math.cos(heading / 2), math.sin(heading / 2)
        pitch_w, pitch_y = np.cos(pitches / 2), np.sin(pitches / 2)
        turn = (yaw_w * pitch_w, -yaw_z * pitch_y, yaw_w * pitch_y, yaw_z * pitch_w)
        self._mocap_quat[index] = np.stack(turn, axis=-1)
        self._ball_centres[index] = (foot[0], foot[1], foot[2] + 0.9)

    def settle(self) -> None:
        """Let every geom follow its body."""
        self._mujoco.mj_kinematics(self._model, self._data)

    def near_solids(self, origin: NDArray[np.float64], rays: NDArray[np.float32]) -> NDArray[np.bool_]:
        """Tell which rays, unit vectors (N, 3), may meet something of the group `SOLID`; true when in doubt.

        Each thing and person is inside a ball; a ray can meet it only within the cone around that ball.
        """
        if not self._ball_radii.size:
            return np.zeros(len(rays), bool)
        to_ball = self._ball_centres - origin
        distance = np.linalg.norm(to_ball, axis=1)
        sine = np.minimum(self._ball_radii / np.maximum(distance, 1e-9), 1.0)
        least = np.where(sine < 1.0, np.sqrt(1.0 - sine**2), -2.0) - 1e-4  # single precision below
        axes = (to_ball / np.maximum(distance, 1e-9)[:, None]).astype(np.float32)
        near: NDArray[np.bool_] = (rays @ axes.T >= least.astype(np.float32)).any(axis=1)
        return near

    def cast(
        self, origin: NDArray[np.float64], rays: NDArray[np.float64], *, groups: Sequence[int], normals: bool
    ) -> tuple[NDArray[np.int32], NDArray[np.float64], NDArray[np.float64] | None]:
        """Cast unit rays (N, 3) from one place against the given geom groups.

        Returns:
            The geom met (N,) and its distance (N,), m, both -1 for none; surface normals (N, 3) if asked.
        """
        count = len(rays)
        geom, distance = np.full(count, -1, np.int32), np.full(count, -1.0)
        normal = np.zeros((count, 3)) if normals else None
        if count:
            chosen = np.zeros(6, np.uint8)
            chosen[list(groups)] = 1
            self._mujoco.mj_multiRay(
                self._model,
                self._data,
                origin,
                np.ascontiguousarray(rays).reshape(-1),
                chosen,
                True,
                -1,
                geom,
                distance,
                None if normal is None else normal.reshape(-1),
                count,
                1e6,
            )
        return geom, distance, normal

    def _balls(self, people: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return centres (B, 3) and radii (B,) of balls around the people, then each part of each thing."""
        solid = np.flatnonzero(
            (self._model.geom_group == SOLID) & (self.class_of_geom[:-1] == MaskClass.OBSTACLE)
        )
        centres = np.vstack([np.zeros((people, 3)), self._data.geom_xpos[solid]])
        return centres, np.concatenate([np.full(people, REACH_M), self._model.geom_rbound[solid]])

    def _add_surfaces(self, spec: Any, scene: Scene) -> None:
        kinds = self._mujoco.mjtGeom
        rgba = (*scene.ground.rgb, 1.0)
        terrain = scene.terrain
        if terrain.is_flat:
            spec.worldbody.add_geom(
                name="ground", type=kinds.mjGEOM_PLANE, size=[0, 0, 1], rgba=rgba, group=SURFACE
            )
        else:
            rows, columns = terrain.heights.shape
            rise = float(np.ptp(terrain.heights))
            spec.add_hfield(
                name="terrain",
                size=[terrain.half_m, terrain.half_m, rise, 0.5],
                nrow=rows,
                ncol=columns,
                userdata=((terrain.heights - terrain.lowest_m) / rise).reshape(-1),
            )
            spec.worldbody.add_geom(
                name="ground",
                type=kinds.mjGEOM_HFIELD,
                hfieldname="terrain",
                pos=[0, 0, terrain.lowest_m],
                rgba=rgba,
                group=SURFACE,
            )
        if scene.wall_height_m:
            half_x, half_y, tall = scene.half_x_m, scene.half_y_m, scene.wall_height_m / 2
            for name, x, y in (("east", 1, 0), ("west", -1, 0), ("north", 0, 1), ("south", 0, -1)):
                thick = WALL_THICKNESS_M / 2
                spec.worldbody.add_geom(
                    name=f"{name} wall",
                    type=kinds.mjGEOM_BOX,
                    size=[thick if x else half_x + 2 * thick, thick if y else half_y + 2 * thick, tall],
                    pos=[x * (half_x + thick), y * (half_y + thick), tall],
                    rgba=(*scene.wall_rgb, 1.0),
                    group=SURFACE,
                )

    def _add_thing(self, spec: Any, scene: Scene, index: int) -> None:
        kinds = self._mujoco.mjtGeom
        shapes = {
            "box": kinds.mjGEOM_BOX,
            "cylinder": kinds.mjGEOM_CYLINDER,
            "ellipsoid": kinds.mjGEOM_ELLIPSOID,
        }
        thing = self._things[index]
        half_yaw = thing.yaw / 2
        body = spec.worldbody.add_body(
            name=f"thing {index}",
            pos=[thing.x, thing.y, scene.terrain.height(thing.x, thing.y)],
            quat=[math.cos(half_yaw), 0, 0, math.sin(half_yaw)],
        )
        for number, part in enumerate(thing.parts):
            name = f"thing {index} part {number}"
            self._windows[name] = part.windows
            across, along, tall = part.half
            size = [across, tall, 0.0] if part.shape == "cylinder" else [across, along, tall]
            body.add_geom(
                name=name, type=shapes[part.shape], size=size, pos=part.at, rgba=(*part.rgb, 1.0), group=SOLID
            )

    def _add_person(self, spec: Any, index: int) -> list[str]:
        """Add a person and return the names of its bodies."""
        kinds = self._mujoco.mjtGeom
        shapes = {"capsule": kinds.mjGEOM_CAPSULE, "ellipsoid": kinds.mjGEOM_ELLIPSOID}
        skin, hair = _SKIN_AND_HAIR[index % len(_SKIN_AND_HAIR)]
        shirt, trousers = _CLOTHES[index % len(_CLOTHES)]
        colours: dict[Role, Rgb] = {
            "skin": skin,
            "hair": hair,
            "shirt": shirt,
            "trousers": trousers,
            "shoes": (0.10, 0.09, 0.09),
        }
        names = [f"person {index} limb {number}" for number in range(len(LIMBS))]
        for name, limb in zip(names, LIMBS, strict=True):
            body = spec.worldbody.add_body(name=name, mocap=True)
            rgba = (*colours[limb.role], 1.0)
            body.add_geom(name=name, type=shapes[limb.shape], size=limb.size, rgba=rgba, group=SOLID)
        return names
