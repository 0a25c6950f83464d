"""Ray casting with MuJoCo; the only module that uses MuJoCo. No dynamics are stepped.

`mj_multiRay` costs about 10 ns per ray and geom, even for geoms that it could skip. So each object is a small
model of its own, and gets only the rays that come near it.
"""

from __future__ import annotations

import functools
import os
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from adatracker_deploy.sim.scene import Rgb, Scene

Array = NDArray[np.float64]

_WALL_HALF_THICKNESS_M = 0.1
_NO_LIMIT_M = 1e6


@dataclass(frozen=True, slots=True)
class Primitive:
    """A coloured solid in its body's frame."""

    shape: Literal["box", "cylinder", "ellipsoid", "capsule"]
    half: tuple[float, float, float]
    """Half-widths, m. Cylinder and capsule: radius, radius, half the length of the straight part."""
    at: tuple[float, float, float]
    rgb: Rgb


@dataclass(frozen=True, slots=True)
class Rays:
    """Rays from one origin, in the scene's frame.

    Rays are multiplied by `einsum`, which, unlike BLAS, starts no threads: on busy cores such threads made an
    image five times slower.
    """

    origin: Array
    """(3,), m."""
    ways: Array
    """Unit vectors (3, N)."""

    def __len__(self) -> int:
        return int(self.ways.shape[1])

    def only(self, chosen: NDArray[np.intp]) -> Rays:
        """Return the rays with these indices."""
        return Rays(self.origin, self.ways[:, chosen])


class Caster:
    """One or more bodies, made of primitives, that rays are cast against.

    Attributes:
        rgb: the colour of each primitive in the given order, float32 (G, 3).
    """

    def __init__(self, model: Any) -> None:
        """Take a compiled model; see `of_bodies` and `of_surfaces`."""
        mujoco = _mujoco()
        self._mujoco = mujoco
        self._model = model
        self._data = mujoco.MjData(model)
        mujoco.mj_kinematics(model, self._data)
        self.rgb = model.geom_rgba[:, :3].astype(np.float32)

    @classmethod
    def of_bodies(cls, bodies: tuple[tuple[Primitive, ...], ...]) -> Caster:
        """Return a caster of bodies that `place` can move; at first all are at the origin."""
        return cls(_model_of(bodies))

    @classmethod
    def of_surfaces(cls, scene: Scene) -> Caster:
        """Return a caster of the scene's ground, which is primitive 0, and its walls."""
        return cls(_surfaces_of(scene))

    def place(self, position: Array, quaternion: Array) -> None:
        """Put the bodies at positions (B, 3), m, turned by unit quaternions (B, 4), w first."""
        self._data.mocap_pos[:] = position
        self._data.mocap_quat[:] = quaternion
        self._mujoco.mj_kinematics(self._model, self._data)

    def ball(self) -> tuple[Array, float]:
        """Return the centre (3,) and the radius, m, of a sphere around everything, as currently placed."""
        centres, radii = self._data.geom_xpos, self._model.geom_rbound[:, None]
        middle = ((centres - radii).min(axis=0) + (centres + radii).max(axis=0)) / 2
        return middle, float((np.linalg.norm(centres - middle, axis=1) + radii[:, 0]).max())

    def cast(self, rays: Rays, normal: Array | None = None) -> tuple[NDArray[np.int32], Array]:
        """Return the first primitive that each ray hits (N,), -1 for none, and its distance, m.

        If `normal`, C-contiguous (N, 3), is given, the unit normals of the hits are written into it.
        """
        count = len(rays)
        geom, distance = np.full(count, -1, np.int32), np.full(count, -1.0)
        if count:
            self._mujoco.mj_multiRay(
                self._model,
                self._data,
                rays.origin,
                rays.ways.T.reshape(-1),
                None,
                True,
                -1,
                geom,
                distance,
                None if normal is None else normal.reshape(-1),
                count,
                _NO_LIMIT_M,
            )
        return geom, distance


def _mujoco() -> Any:
    os.environ.setdefault("MUJOCO_GL", "off")  # rays need no window: with one it starts a process for GLFW
    import mujoco

    return mujoco


@functools.lru_cache(maxsize=256)
def _model_of(bodies: tuple[tuple[Primitive, ...], ...]) -> Any:
    mujoco = _mujoco()
    kinds = {
        "box": mujoco.mjtGeom.mjGEOM_BOX,
        "cylinder": mujoco.mjtGeom.mjGEOM_CYLINDER,
        "ellipsoid": mujoco.mjtGeom.mjGEOM_ELLIPSOID,
        "capsule": mujoco.mjtGeom.mjGEOM_CAPSULE,
    }
    spec = mujoco.MjSpec()
    for primitives in bodies:
        body = spec.worldbody.add_body(mocap=True)
        for one in primitives:
            x, y, z = one.half
            size = [x, z, 0.0] if one.shape in {"cylinder", "capsule"} else [x, y, z]
            body.add_geom(type=kinds[one.shape], size=size, pos=one.at, rgba=(*one.rgb, 1.0))
    return spec.compile()


def _surfaces_of(scene: Scene) -> Any:
    mujoco = _mujoco()
    spec = mujoco.MjSpec()
    terrain = scene.terrain
    ground = {"rgba": (*scene.ground.rgb, 1.0)}
    if terrain.is_flat:
        spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0, 0, 1], **ground)
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
        kind, low = mujoco.mjtGeom.mjGEOM_HFIELD, [0, 0, terrain.lowest_m]
        spec.worldbody.add_geom(type=kind, hfieldname="terrain", pos=low, **ground)
    if scene.wall_height_m:
        thick, tall = _WALL_HALF_THICKNESS_M, scene.wall_height_m / 2
        half_x, half_y = scene.half_x_m, scene.half_y_m
        for x, y in ((1, 0), (-1, 0), (0, 1), (0, -1)):
            spec.worldbody.add_geom(
                type=mujoco.mjtGeom.mjGEOM_BOX,
                size=[thick if x else half_x + 2 * thick, thick if y else half_y + 2 * thick, tall],
                pos=[x * (half_x + thick), y * (half_y + thick), tall],
                rgba=(*scene.wall_rgb, 1.0),
            )
    return spec.compile()
