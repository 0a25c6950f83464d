"""A pinhole camera by ray casting: class masks fast, RGB images with sun, shadows and painted ground."""

from __future__ import annotations

import functools
import math

import numpy as np
from numpy.typing import NDArray

from adatracker_deploy.core.geometry import Pose
from adatracker_deploy.core.messages import ClassMask
from adatracker_deploy.sim.caster import Array, Rays
from adatracker_deploy.sim.paint import Surfaces, paint
from adatracker_deploy.sim.scene import Scene
from adatracker_deploy.sim.stage import GROUND, NOTHING, Stage

_SUN = np.array([0.42, 0.28, 0.86]) / np.linalg.norm([0.42, 0.28, 0.86])
"""Direction to the sun."""
_SUN_AT = _SUN * 400.0
"""Origin of the shadow rays: far enough for almost parallel light, near enough for exact rays."""
_SKIN_M = 0.02
"""Offset that keeps a surface from shading itself."""


@functools.lru_cache(maxsize=32)
def pixel_rays(fov_rad: float, height: int, width: int) -> NDArray[np.float64]:
    """Return unit vectors (3, height * width) through the centres of square pixels, row by row from the top.

    Args:
        fov_rad: horizontal field of view, below pi.
        height: rows.
        width: columns.

    The frame is the camera's: x along the optical axis, y left, z up. The array is shared; it is read-only.
    """
    focal_px = width / 2 / math.tan(fov_rad / 2)
    across = (width / 2 - 0.5 - np.arange(width)) / focal_px
    up = (height / 2 - 0.5 - np.arange(height)) / focal_px
    left, upward = np.meshgrid(across, up)
    rays = np.stack([np.ones_like(left), left, upward]).reshape(3, -1)
    rays /= np.linalg.norm(rays, axis=0)
    rays.flags.writeable = False
    return rays


class Camera:
    """Renders a stage; keeps no state between images."""

    def __init__(self, scene: Scene, stage: Stage) -> None:
        """Create a camera for `stage`, which was built from `scene`."""
        self._scene = scene
        self._stage = stage

    def mask(self, pose: Pose, fov_rad: float, height: int, width: int) -> ClassMask:
        """Return the class mask (height, width), the same as `image` returns, at a fraction of its cost."""
        rays = _rays(pose, fov_rad, height, width)
        hits = self._stage.solids(rays)
        # Ground and walls are background: they matter only where they occlude something.
        if not self._all_is_before_surfaces(pose):
            self._stage.surfaces(rays, hits, np.flatnonzero(hits.primitive >= 0))
        return self._stage.class_of[hits.primitive].reshape(height, width)

    def image(
        self, pose: Pose, fov_rad: float, height: int, width: int
    ) -> tuple[ClassMask, NDArray[np.uint8]]:
        """Return the class mask (height, width) and the RGB image (height, width, 3), both uint8."""
        rays = _rays(pose, fov_rad, height, width)
        hits = self._stage.solids(rays, normals=True)
        self._stage.surfaces(rays, hits, np.arange(len(rays)))
        assert hits.normal is not None
        seen = np.flatnonzero(hits.primitive != NOTHING)
        primitive, distance, normal = hits.primitive[seen], hits.distance[seen], hits.normal[seen]
        point = rays.origin + (rays.ways[:, seen] * distance).T
        surfaces = Surfaces(
            point=point,
            normal=normal,
            distance=distance,
            light=self._sunlight(point, normal),
            rgb=self._stage.rgb_of[primitive],
            is_ground=primitive == GROUND,
            has_windows=self._stage.windows_of[primitive],
        )
        rgb = paint(self._scene, rays.ways[2], seen, surfaces)
        return self._stage.class_of[hits.primitive].reshape(height, width), rgb.reshape(height, width, 3)

    def _all_is_before_surfaces(self, eye: Pose) -> bool:
        """Return whether no ground or wall can occlude anything: the camera and all solids are in a level
        arena."""
        scene = self._scene
        within = abs(eye.x) < scene.half_x_m and abs(eye.y) < scene.half_y_m and eye.z > 0.0
        return within and scene.terrain.is_flat and not scene.surroundings

    def _sunlight(self, point: Array, normal: Array) -> Array:
        """Return the cosine of the sun's incidence, 0 in the shade of a solid, shape (N,)."""
        light: Array = np.maximum(np.einsum("nj,j->n", normal, _SUN), 0.0)
        facing = np.flatnonzero(light)
        ways = (point[facing] - _SUN_AT).T
        distance = np.linalg.norm(ways, axis=0)
        met = self._stage.solids(Rays(_SUN_AT, ways / distance))
        light[facing[met.distance < distance - _SKIN_M]] = 0.0
        return light


def _rays(pose: Pose, fov_rad: float, height: int, width: int) -> Rays:
    ways = np.einsum("ij,jn->in", pose.rotation(), pixel_rays(fov_rad, height, width))
    return Rays(pose.translation(), ways)
