"""Fog in pictures, by Koschmieder's law, and the distance of what a picture shows. Pure.

The software rasteriser has neither fog nor a depth that can be read. So the distance of each pixel follows
from what it shows: people and things are as far as their nearest point, ground and walls where the ray meets
them, and the sky is infinitely far.
"""

from __future__ import annotations

import functools
import math
from typing import TYPE_CHECKING

import cv2
import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from adatracker_deploy.core.geometry import Pose
    from adatracker_deploy.sim.scene import Rgb, Scene

THRESHOLD = 0.05
"""Contrast that is left at the meteorological optical range (WMO-No. 8, chapter on visibility)."""
_FAR_M = 1e4


def fogged(
    picture: NDArray[np.uint8], distance_m: NDArray[np.float32], fog_m: float, air: Rgb
) -> NDArray[np.uint8]:
    """Return a picture (H, W, 3) as fog shows it: L = L0 t + air (1 - t), with t = exp(-sigma d).

    Koschmieder, "Theorie der horizontalen Sichtweite", 1924; sigma = -ln(0.05) / fog_m.

    Args:
        picture: by clear air.
        distance_m: of what each pixel shows, (H, W).
        fog_m: the meteorological optical range.
        air: the fog's own colour, 0 to 1.
    """
    through = cv2.exp(distance_m * np.float32(math.log(THRESHOLD) / fog_m))[..., None]
    shown = picture * through + np.float32(255.0) * np.array(air, np.float32) * (np.float32(1.0) - through)
    return np.asarray(cv2.convertScaleAbs(shown), np.uint8)


def background_m(camera: Pose, fov_rad: float, height: int, width: int, scene: Scene) -> NDArray[np.float32]:
    """Return how far ground, walls or sky are, (height, width), m; slopes count as flat ground."""
    rays = _rays(fov_rad, height, width) @ camera.rotation().T.astype(np.float32)
    above = camera.z - scene.terrain.height(camera.x, camera.y)
    with np.errstate(divide="ignore", invalid="ignore"):
        ground = np.where(rays[..., 2] < 0.0, -above / rays[..., 2], _FAR_M)
        if not scene.wall_height_m:
            return np.minimum(ground, _FAR_M).astype(np.float32)
        walls = np.minimum(
            (np.copysign(scene.half_x_m, rays[..., 0]) - camera.x) / rays[..., 0],
            (np.copysign(scene.half_y_m, rays[..., 1]) - camera.y) / rays[..., 1],
        )
        over = above + walls * rays[..., 2] > scene.wall_height_m
    walls = np.where(over | ~(walls > 0.0), _FAR_M, walls)
    return np.minimum(np.minimum(ground, walls), _FAR_M).astype(np.float32)


@functools.lru_cache(maxsize=4)
def _rays(fov_rad: float, height: int, width: int) -> NDArray[np.float32]:
    """Return each pixel's unit vector in the camera's frame (ahead, left, up), (height, width, 3)."""
    focal_px = width / 2 / math.tan(fov_rad / 2)
    left, up = np.meshgrid(
        (width / 2 - 0.5 - np.arange(width)) / focal_px, (height / 2 - 0.5 - np.arange(height)) / focal_px
    )
    rays = np.stack([np.ones_like(left), left, up], axis=-1)
    return np.asarray(rays / np.linalg.norm(rays, axis=-1, keepdims=True), np.float32)
