"""Colours of ray hits: sunlight, painted ground, windows, haze and sky. Pure."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from adatracker_deploy.sim.scene import Ground, Scene

Array = NDArray[np.float64]

_HAZE_M = 140.0
"""Distance at which haze makes up 1 - 1/e of a colour, m."""
_WINDOW = np.array([0.22, 0.29, 0.36])
_LANE_HALF_WIDTH_M = 0.08
_LINE_FADES_M = 40.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Surfaces:
    """The hits of N rays; lengths in m, in the scene's frame."""

    point: Array
    """(N, 3)."""
    normal: Array
    """Unit, (N, 3)."""
    distance: Array
    """From the camera, (N,)."""
    light: Array
    """Cosine of the sun's incidence, 0 in the shade, (N,)."""
    rgb: NDArray[np.float32]
    """Reflectance, (N, 3)."""
    is_ground: NDArray[np.bool_]
    has_windows: NDArray[np.bool_]


def paint(scene: Scene, rise: Array, seen: NDArray[np.intp], surfaces: Surfaces) -> NDArray[np.uint8]:
    """Return the colours uint8 (M, 3) of M unit rays, of which the N with indices `seen` hit `surfaces`.

    `rise` is the upward component of each ray, (M,).

    Lambert's cosine law for the sun, plus sky light that is slightly stronger on surfaces facing up.
    """
    haze, sky = np.array(scene.haze_rgb), np.array(scene.sky_rgb)
    height = np.sqrt(np.clip(rise, 0.0, 1.0))[:, None]
    image = haze + (sky - haze) * height
    colour = surfaces.rgb.astype(np.float64)
    ground, windows = surfaces.is_ground, surfaces.has_windows
    colour[ground] = _ground(scene.ground, surfaces.point[ground], surfaces.distance[ground])
    colour[windows] = _facade(colour[windows], surfaces.point[windows], surfaces.normal[windows])
    ambient = 0.50 + 0.10 * surfaces.normal[:, 2]
    lit = colour * (ambient + 0.62 * surfaces.light)[:, None]
    clear = np.exp(-surfaces.distance / _HAZE_M)[:, None]
    image[seen] = haze + (lit - haze) * clear
    pixels: NDArray[np.uint8] = (image.clip(0.0, 1.0) * 255.0 + 0.5).astype(np.uint8)
    return pixels


def _ground(ground: Ground, point: Array, distance: Array) -> Array:
    """Mix the ground's two colours; squares fade to their mean where they are smaller than pixels."""
    first, second = np.array(ground.rgb), np.array(ground.other_rgb)
    x, y = point[:, 0], point[:, 1]
    if ground.pattern == "lanes":
        across = np.abs((y + ground.period_m / 2) % ground.period_m - ground.period_m / 2)
        line = (across < _LANE_HALF_WIDTH_M) & (x % 4.0 < 2.4)
        return _mix(first, second, np.where(line, np.exp(-distance / _LINE_FADES_M), 0.0))
    column, row = np.floor(x / ground.period_m), np.floor(y / ground.period_m)
    if ground.pattern == "checker":
        share = (column + row) % 2.0
    else:
        # A hash good enough to look irregular: the fraction of a large sine.
        share = np.sin(column * 12.9898 + row * 78.233) * 43758.5453 % 1.0
    sharp = np.exp(-distance / (16.0 * ground.period_m))
    return _mix(first, second, 0.5 + (share - 0.5) * sharp)


def _mix(first: Array, second: Array, share: Array) -> Array:
    mixed: Array = first + (second - first) * share[:, None]
    return mixed


def _facade(colour: Array, point: Array, normal: Array) -> Array:
    """Put a window into each 2.4 m by 3 m of an upright side, from the ground floor up."""
    along = point[:, 1] * normal[:, 0] - point[:, 0] * normal[:, 1]
    u, v = along / 2.4 % 1.0, point[:, 2] / 3.0 % 1.0
    glass = (np.abs(u - 0.5) < 0.27) & (np.abs(v - 0.55) < 0.24) & (np.abs(normal[:, 2]) < 0.5)
    painted: Array = np.where(glass[:, None], _WINDOW, colour)
    return painted
