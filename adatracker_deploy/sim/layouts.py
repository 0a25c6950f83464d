"""Layouts of the scenes: each keeps its own lap clear and places the rest at random."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from adatracker_deploy.sim import things
from adatracker_deploy.sim.footprint import Points
from adatracker_deploy.sim.path import lap_course
from adatracker_deploy.sim.scene import Ground, Lap, Rgb, Scene, Thing
from adatracker_deploy.sim.terrain import Terrain

_LAP_CLEAR_M = 1.5
"""Free space beside a lap, m: for the person, and for a robot that cuts corners behind it."""
_GAP_M = 1.6
"""Space between two randomly placed objects, m: enough for a person and a robot to pass."""

_PAINTS: tuple[Rgb, ...] = (
    (0.76, 0.20, 0.16),
    (0.16, 0.34, 0.58),
    (0.85, 0.85, 0.84),
    (0.14, 0.15, 0.17),
    (0.48, 0.52, 0.55),
    (0.83, 0.63, 0.20),
    (0.20, 0.42, 0.36),
)
_PLASTER: tuple[Rgb, ...] = (
    (0.82, 0.76, 0.64),
    (0.70, 0.58, 0.50),
    (0.66, 0.70, 0.72),
    (0.78, 0.70, 0.70),
    (0.60, 0.45, 0.38),
)
_GREEN: Rgb = (0.26, 0.46, 0.22)


def simple_room(rng: np.random.Generator) -> Scene:
    """A walled room, 24 m by 24 m, with boxes and columns."""
    half, lap = 12.0, Lap(straight_m=0.0, radius_m=6.0, waves=4)
    stand: list[Thing] = []
    for x, y in _spots(rng, 8, half - 1.8, lap_course(lap), radius_m=0.7):
        rgb = _pick(rng, _PAINTS)
        if rng.random() < 0.6:
            size = (rng.uniform(0.5, 1.0), rng.uniform(0.4, 0.9), rng.uniform(0.6, 2.0))
            stand.append(things.crate(x, y, rng.uniform(0, math.pi), size, rgb))
        else:
            stand.append(things.column(x, y, rng.uniform(0.2, 0.45), rng.uniform(0.8, 2.4), rgb))
    return Scene(
        name="simple_room",
        half_x_m=half,
        half_y_m=half,
        lap=lap,
        ground=Ground(rgb=(0.58, 0.56, 0.53), other_rgb=(0.44, 0.43, 0.42)),
        things=tuple(stand),
        wall_height_m=3.0,
    )


def parking_lot(rng: np.random.Generator) -> Scene:
    """A car park with a row of cars in the middle, one on each side, and lamp posts."""
    cars = [
        things.car(x, y + rng.uniform(-0.15, 0.15), math.pi / 2, _pick(rng, _PAINTS))
        for y, bays in ((0.0, range(-3, 4)), (10.8, range(-6, 7)), (-10.8, range(-6, 7)))
        for x in (2.8 * bay for bay in bays)
        if rng.random() < 0.75
    ]
    lamps = [things.lamp_post(x, y) for x in (-10.8, 10.8) for y in (-1.0, 1.0)]
    blocks = [
        things.house(x, 22.0, (14.0, 9.0, 6.0 + 3.0 * n), _PLASTER[n]) for n, x in enumerate((-16, 0, 16))
    ]
    return Scene(
        name="parking_lot",
        half_x_m=21.0,
        half_y_m=14.0,
        lap=Lap(straight_m=17.0, radius_m=6.2, weave_m=0.8, waves=7),
        ground=Ground(rgb=(0.27, 0.28, 0.29), other_rgb=(0.80, 0.80, 0.76), pattern="lanes", period_m=7.0),
        things=(*cars, *lamps),
        surroundings=tuple(blocks),
        wall_height_m=1.0,
        wall_rgb=(0.62, 0.62, 0.60),
        haze_rgb=(0.70, 0.73, 0.78),
        sky_rgb=(0.42, 0.50, 0.62),
    )


def urban_city(rng: np.random.Generator) -> Scene:
    """Streets around a block, between rows of tall houses."""
    block = things.house(0.0, 0.0, (14.0, 7.0, 12.0), _PLASTER[1])
    corners = [things.lamp_post(x, y) for x in (-20.5, 0.0, 20.5) for y in (-12.6, 12.6)]
    clutter = [
        things.crate(x, y, 0.0, (0.7, 0.7, 1.1), (0.20, 0.36, 0.30))
        if rng.random() < 0.5
        else things.car(x, y, 0.0, _pick(rng, _PAINTS))
        for x, y in ((-5.0, 5.6), (4.0, 5.6), (-4.0, -5.6), (5.0, -5.6))
    ]
    rows = [
        things.house(x, y, (13.0, 10.0, rng.uniform(9.0, 21.0)), _pick(rng, _PLASTER))
        for x in (-20.5, -6.8, 6.8, 20.5)
        for y in (-19.5, 19.5)
    ]
    ends = [
        things.house(x, y, (10.0, 12.6, rng.uniform(9.0, 18.0)), _pick(rng, _PLASTER))
        for x in (-29.5, 29.5)
        for y in (-6.6, 6.6)
    ]
    return Scene(
        name="urban_city",
        half_x_m=24.0,
        half_y_m=14.0,
        lap=Lap(straight_m=14.0, radius_m=9.0, waves=8),
        ground=Ground(rgb=(0.40, 0.40, 0.41), other_rgb=(0.33, 0.33, 0.35), period_m=2.0),
        things=(block, *corners, *clutter),
        surroundings=(*rows, *ends),
    )


def urban_road(rng: np.random.Generator) -> Scene:
    """A long road between trees and houses, with lamp posts on its middle line."""
    trees = [
        things.tree(x, y + rng.uniform(-0.2, 0.2), rng.uniform(0.9, 1.1), _GREEN)
        for x in np.arange(-36.0, 37.0, 8.0).tolist()
        for y in (-7.2, 7.2)
    ]
    lamps = [things.lamp_post(x, 0.0) for x in (-24.0, -12.0, 0.0, 12.0, 24.0)]
    houses = [
        things.house(x, y, (rng.uniform(8.0, 10.5), 8.0, rng.uniform(4.5, 9.0)), _pick(rng, _PLASTER))
        for x in np.arange(-38.0, 39.0, 12.6).tolist()
        for y in (-15.0, 15.0)
    ]
    return Scene(
        name="urban_road",
        half_x_m=40.0,
        half_y_m=9.0,
        lap=Lap(straight_m=56.0, radius_m=4.2, weave_m=0.8, waves=13),
        ground=Ground(rgb=(0.30, 0.31, 0.32), other_rgb=(0.88, 0.86, 0.78), pattern="lanes", period_m=6.0),
        things=(*trees, *lamps),
        surroundings=tuple(houses),
        margin_m=1.5,
    )


def snow_village(rng: np.random.Generator) -> Scene:
    """Huts and firs on rolling, snowy ground."""
    half, lap = 20.0, Lap(straight_m=0.0, radius_m=9.0, waves=5)
    stand: list[Thing] = []
    for n, (x, y) in enumerate(_spots(rng, 13, half - 4.0, lap_course(lap), radius_m=2.4)):
        if n < 4:
            stand.append(things.hut(x, y, rng.uniform(0, math.tau), (0.45, 0.30, 0.20)))
        else:
            stand.append(things.fir(x, y, rng.uniform(0.8, 1.3)))
    wood: list[Thing] = []
    for angle in np.linspace(0.0, math.tau, 24, endpoint=False).tolist():
        out = (half + rng.uniform(2.0, 6.0)) / max(abs(math.cos(angle)), abs(math.sin(angle)))
        wood.append(things.fir(out * math.cos(angle), out * math.sin(angle), 1.5))
    return Scene(
        name="snow_village",
        half_x_m=half,
        half_y_m=half,
        lap=lap,
        ground=Ground(rgb=(0.82, 0.85, 0.89), other_rgb=(0.76, 0.79, 0.85), pattern="speckle", period_m=0.3),
        things=tuple(stand),
        surroundings=tuple(wood),
        terrain=_hills(rng),
        sky_rgb=(0.58, 0.66, 0.76),
        haze_rgb=(0.84, 0.87, 0.90),
    )


def _hills(rng: np.random.Generator) -> Terrain:
    """Return hills of about 0.7 m over 12 to 25 m: slopes that a small robot climbs, at most 1 in 4."""
    half, count = 45.0, 61
    place = np.linspace(-half, half, count)
    x, y = np.meshgrid(place, place)
    heights = np.zeros((count, count))
    for wavelength, amplitude in ((25.0, 0.40), (18.0, 0.22), (12.0, 0.10)):
        direction, phase = rng.uniform(0, math.tau), rng.uniform(0, math.tau, 2)
        u = x * math.cos(direction) + y * math.sin(direction)
        v = y * math.cos(direction) - x * math.sin(direction)
        k = math.tau / wavelength
        heights += amplitude * np.sin(k * u + phase[0]) * np.sin(k * v + phase[1])
    return Terrain(half_m=half, heights=heights)


def _spots(
    rng: np.random.Generator, count: int, half_m: float, course: Points, radius_m: float
) -> list[tuple[float, float]]:
    """Return up to `count` random positions for objects of this radius, clear of the course and of each
    other."""
    found: list[tuple[float, float]] = []
    for _ in range(40 * count):
        x, y = rng.uniform(-half_m, half_m, 2).tolist()
        off_course = np.hypot(course[:, 0] - x, course[:, 1] - y).min() >= radius_m + _LAP_CLEAR_M
        if off_course and all(math.dist((x, y), other) >= 2 * radius_m + _GAP_M for other in found):
            found.append((x, y))
        if len(found) == count:
            break
    return found


def _pick(rng: np.random.Generator, colours: Sequence[Rgb]) -> Rgb:
    return colours[int(rng.integers(len(colours)))]
