"""Procedural textures: tileable RGB images, by material. Pure."""

from __future__ import annotations

import functools

import numpy as np
from numpy.typing import NDArray

from adatracker_deploy.sim.scene import Ground, Rgb

Image = NDArray[np.uint8]
Array = NDArray[np.float64]

SIDE_PX = 256
"""Height and width; a power of two."""


@functools.lru_cache(maxsize=64)
def ground(paint: Ground, seed: int) -> tuple[Image, float]:
    """Return a ground's texture (256, 256, 3) and the metres that it covers before it repeats.

    Args:
        paint: the scene's.
        seed: of its grain.
    """
    rng = np.random.default_rng(seed)
    first, second = np.array(paint.rgb), np.array(paint.other_rgb)
    grain = 0.5 * _noise(rng, 6) + 0.3 * _noise(rng, 24) + 0.2 * _noise(rng, 96)
    if paint.pattern == "checker":
        tiles = 4
        u = np.arange(SIDE_PX) * tiles / SIDE_PX
        column, row = np.meshgrid(u, u)
        share = (np.floor(column) + np.floor(row)) % 2.0
        joint = (np.minimum(column % 1.0, row % 1.0) < 0.025)[..., None]
        image = _mix(first, second, share) * (1.0 + 0.10 * grain[..., None])
        image = np.where(joint, 0.6 * image, image)
        return _pixels(image), tiles * paint.period_m
    if paint.pattern == "lanes":
        # Lines across y, dashed along x: one period high, as many metres wide.
        period = paint.period_m
        along = np.arange(SIDE_PX) / SIDE_PX * period
        x, y = np.meshgrid(along, along)
        dash = 4.0 * period / max(1.0, round(period / 4.0)) / period if period >= 4.0 else period
        across = np.abs((y + period / 2) % period - period / 2)
        line = (across < 0.09) & ((x % dash) < 0.6 * dash)
        image = np.broadcast_to(first, (SIDE_PX, SIDE_PX, 3)) * (1.0 + 0.16 * grain[..., None])
        speckles = rng.random((SIDE_PX, SIDE_PX)) < 0.06
        image = np.where(speckles[..., None], image * 1.22, image)
        return _pixels(np.where(line[..., None], second, image)), period
    share = np.clip(0.5 + 0.9 * grain, 0.0, 1.0)
    image = _mix(first, second, share) * (1.0 + 0.06 * _noise(rng, 128)[..., None])
    return _pixels(image), 24.0 * paint.period_m


@functools.lru_cache(maxsize=64)
def plaster(rgb: Rgb, seed: int) -> Image:
    """Return a wall or a painted surface with stains."""
    rng = np.random.default_rng(seed)
    grain = 0.6 * _noise(rng, 4) + 0.4 * _noise(rng, 40)
    return _pixels(np.array(rgb) * (1.0 + 0.14 * grain[..., None]))


@functools.lru_cache(maxsize=16)
def facade(rgb: Rgb, seed: int) -> Image:
    """Return one storey's worth of a house: a window with a frame and a sill."""
    image = plaster(rgb, seed).astype(float) / 255.0
    v, u = np.mgrid[0:SIDE_PX, 0:SIDE_PX] / SIDE_PX
    glass = (np.abs(u - 0.5) < 0.24) & (np.abs(v - 0.45) < 0.24)
    frame = (np.abs(u - 0.5) < 0.27) & (np.abs(v - 0.45) < 0.27) & ~glass
    cross = glass & ((np.abs(u - 0.5) < 0.012) | (np.abs(v - 0.38) < 0.012))
    sill = (np.abs(u - 0.5) < 0.30) & (np.abs(v - 0.735) < 0.018)
    image[glass] = np.array([0.20, 0.26, 0.32]) * (0.8 + 0.5 * (1 - v[glass]))[:, None]
    image[frame | cross | sill] = (0.82, 0.82, 0.80)
    return _pixels(image)


@functools.lru_cache(maxsize=16)
def leaves(rgb: Rgb, seed: int) -> Image:
    """Return foliage: light and dark spots."""
    rng = np.random.default_rng(seed)
    spots = 0.6 * _noise(rng, 48) + 0.4 * _noise(rng, 110)
    return _pixels(np.array(rgb) * (1.0 + 0.55 * spots[..., None]))


def sky(zenith: Rgb, horizon: Rgb, cloudy: float, seed: int) -> Image:
    """Return a sky for a dome: columns go round, rows from the zenith down to below the horizon.

    Args:
        zenith: colour overhead.
        horizon: colour at the horizon and below.
        cloudy: share of the sky in cloud, 0 to 1.
        seed: of the clouds.
    """
    rng = np.random.default_rng(seed)
    up = np.linspace(1.0, -0.2, SIDE_PX)[:, None, None]
    image = np.array(horizon) + (np.array(zenith) - np.array(horizon)) * np.sqrt(np.clip(up, 0, 1))
    image = np.broadcast_to(image, (SIDE_PX, SIDE_PX, 3))
    puffs = 0.6 * _noise(rng, 5) + 0.3 * _noise(rng, 14) + 0.1 * _noise(rng, 40)
    cover = np.clip((puffs + 2.2 * cloudy - 1.2) * 1.6, 0.0, 0.9)[..., None] * np.clip(up * 4.0, 0.0, 1.0)
    return _pixels(image * (1 - cover) + np.array([0.92, 0.93, 0.95]) * cover)


@functools.lru_cache(maxsize=1)
def shadow() -> NDArray[np.uint8]:
    """Return a soft round shadow's opacity, (64, 64)."""
    v, u = np.mgrid[-1:1:64j, -1:1:64j]
    opacity = 255 * 0.55 * np.clip(1.15 - np.hypot(u, v) * 1.15, 0.0, 1.0) ** 0.7
    return np.asarray(np.round(opacity), np.uint8)


def _noise(rng: np.random.Generator, cells: int) -> Array:
    """Return smooth noise that tiles, about -1 to 1: random values on a grid, interpolated by cosines."""
    grid = rng.uniform(-1.0, 1.0, (cells, cells))
    at = np.arange(SIDE_PX) * cells / SIDE_PX
    low = np.floor(at).astype(int)
    high, share = (low + 1) % cells, 0.5 - 0.5 * np.cos(np.pi * (at - low))
    rows = grid[low] * (1 - share[:, None]) + grid[high] * share[:, None]
    noise: Array = rows[:, low] * (1 - share) + rows[:, high] * share
    return noise


def _mix(first: Array, second: Array, share: Array) -> Array:
    mixed: Array = first + (second - first) * share[..., None]
    return mixed


def _pixels(image: Array) -> Image:
    pixels: Image = np.round(255 * np.clip(image, 0.0, 1.0)).astype(np.uint8)
    pixels.flags.writeable = False
    return pixels
