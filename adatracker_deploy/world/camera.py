"""A pinhole camera by ray casting: class masks fast, RGB images with sun, shadows and painted ground."""

from __future__ import annotations

import functools
import math

import numpy as np
from numpy.typing import NDArray

from adatracker_deploy.geometry import Pose
from adatracker_deploy.messages import ClassMask
from adatracker_deploy.world.paint import Surfaces, paint
from adatracker_deploy.world.scene import Scene
from adatracker_deploy.world.stage import SOLID, SURFACE, Stage

_SUN = np.array([0.42, 0.28, 0.86]) / np.linalg.norm([0.42, 0.28, 0.86])
"""Direction to the sun."""
_SUN_AT = _SUN * 400.0
"""Far enough for almost parallel light, near enough for exact rays: shadows are cast from here."""


@functools.lru_cache(maxsize=32)
def pixel_rays(fov_rad: float, height: int, width: int) -> NDArray[np.float64]:
    """Return unit vectors (height * width, 3) through the middles of square pixels, row by row from the top.

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
    rays = np.stack([np.ones_like(left), left, upward], axis=-1).reshape(-1, 3)
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    rays.flags.writeable = False
    return rays


class Camera:
    """Sees a stage; keeps nothing from one image to the next."""

    def __init__(self, scene: Scene, stage: Stage) -> None:
        """Look at `stage`, which was built from `scene`."""
        self._scene = scene
        self._stage = stage
        self._surfaces_hide = not scene.terrain.is_flat or bool(scene.wall_height_m and scene.surroundings)

    def mask(self, pose: Pose, fov_rad: float, height: int, width: int) -> ClassMask:
        """Return the class mask (height, width), the same that `image` returns, at a fraction of its cost."""
        origin, rays, near = self._aim(pose, fov_rad, height, width)
        groups = (SOLID,) if self._nothing_in_between(pose) else (SOLID, SURFACE)
        geom = np.full(len(rays), -1, np.int32)
        geom[near], _, _ = self._stage.cast(origin, rays[near], groups=groups, normals=False)
        return self._stage.class_of_geom[geom].reshape(height, width)

    def image(
        self, pose: Pose, fov_rad: float, height: int, width: int
    ) -> tuple[ClassMask, NDArray[np.uint8]]:
        """Return the class mask (height, width) and the RGB image (height, width, 3), both uint8."""
        origin, rays, near = self._aim(pose, fov_rad, height, width)
        geom = np.empty(len(rays), np.int32)
        distance, normal = np.empty(len(rays)), np.empty((len(rays), 3))
        for chosen, groups in ((near, (SOLID, SURFACE)), (~near, (SURFACE,))):
            geom[chosen], distance[chosen], normal[chosen] = self._stage.cast(
                origin, rays[chosen], groups=groups, normals=True
            )
        seen = geom >= 0
        points = origin + rays[seen] * distance[seen, None]
        facing = normal[seen] @ _SUN
        light = np.where(self._in_sun(points, facing), np.maximum(facing, 0.0), 0.0)
        surfaces = Surfaces(
            point=points,
            normal=normal[seen],
            distance=distance[seen],
            light=light,
            rgb=self._stage.rgb_of_geom[geom[seen]],
            is_ground=geom[seen] == self._stage.ground_geom,
            has_windows=self._stage.windows_of_geom[geom[seen]],
        )
        rgb = paint(self._scene, rays, seen, surfaces)
        return self._stage.class_of_geom[geom].reshape(height, width), rgb.reshape(height, width, 3)

    def _aim(
        self, pose: Pose, fov_rad: float, height: int, width: int
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.bool_]]:
        origin = pose.translation()
        rays = pixel_rays(fov_rad, height, width) @ pose.rotation().T
        return origin, rays, self._stage.near_solids(origin, rays.astype(np.float32))

    def _nothing_in_between(self, pose: Pose) -> bool:
        """Tell whether ground and walls lie behind everything else, as they do from within a flat arena."""
        inside = abs(pose.x) < self._scene.half_x_m and abs(pose.y) < self._scene.half_y_m and pose.z > 0.0
        return inside and not self._surfaces_hide

    def _in_sun(self, points: NDArray[np.float64], facing: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Tell which places see the sun past the solids; those that face away are left as they are."""
        in_sun = facing > 0.0
        rays = points[in_sun] - _SUN_AT
        distance = np.linalg.norm(rays, axis=1)
        rays /= distance[:, None]
        near = self._stage.near_solids(_SUN_AT, rays.astype(np.float32))
        _, met, _ = self._stage.cast(_SUN_AT, rays[near], groups=(SOLID,), normals=False)
        shaded = np.zeros(len(rays), bool)
        shaded[near] = (met >= 0.0) & (met < distance[near] - 0.02)
        in_sun[in_sun] = ~shaded
        return in_sun
