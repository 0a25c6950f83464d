"""Data types of a scene: objects made of primitives, ground, walls, sky, and the lap of an S-path."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

from adatracker_deploy.sim.footprint import FreeSpace, Solid
from adatracker_deploy.sim.terrain import FLAT, Terrain

Rgb = tuple[float, float, float]
"""Red, green and blue reflectance, 0 to 1."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Part:
    """One upright primitive of a thing, placed in the thing's frame (x forward, base on the ground)."""

    shape: Literal["box", "cylinder", "ellipsoid"]
    half: tuple[float, float, float]
    """Half-widths along x, y and z, m; a cylinder is round with radius `half[0]`."""
    at: tuple[float, float, float]
    """Its centre."""
    rgb: Rgb
    windows: bool = False
    """Paint rows of windows on its sides."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Thing:
    """A solid object on the ground; one MuJoCo body."""

    x: float
    y: float
    yaw: float = 0.0
    parts: tuple[Part, ...]

    def solids(self, base_m: float) -> Iterator[Solid]:
        """Yield the solids of its parts, with its base at height `base_m`."""
        cos, sin = math.cos(self.yaw), math.sin(self.yaw)
        for part in self.parts:
            across, along, tall = part.half
            px, py, pz = part.at
            # An ellipse is approximated by the stadium around it; for a circle that is exact.
            radius = 0.0 if part.shape == "box" else min(across, along)
            yield Solid(
                x=self.x + cos * px - sin * py,
                y=self.y + sin * px + cos * py,
                yaw=self.yaw,
                half_x=across - radius,
                half_y=along - radius,
                radius=radius,
                bottom=base_m + pz - tall,
                top=base_m + pz + tall,
            )


@dataclass(frozen=True, slots=True, kw_only=True)
class Ground:
    """The floor's paint: two colours in squares or stripes."""

    rgb: Rgb
    other_rgb: Rgb
    pattern: Literal["checker", "lanes", "speckle"] = "checker"
    period_m: float = 1.0
    """Side of a square, distance between lane lines, or size of a speckle."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Lap:
    """A closed S-shaped course: a stadium (two straights, two half circles) with a sine added across it."""

    straight_m: float
    """Length of each straight, along x; 0 makes a circle."""
    radius_m: float
    weave_m: float = 1.0
    """Amplitude of the sine."""
    waves: int
    """Number of whole S curves in a lap."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Scene:
    """A scene. Its arena is a rectangle around the origin that nobody leaves."""

    name: str
    half_x_m: float
    half_y_m: float
    lap: Lap
    ground: Ground
    things: tuple[Thing, ...]
    """Obstacles in the arena."""
    surroundings: tuple[Thing, ...] = ()
    """Objects along or beyond the arena's edge, present even in an episode without obstacles."""
    terrain: Terrain = FLAT
    wall_height_m: float = 0.0
    """0 if the arena's edge is invisible."""
    wall_rgb: Rgb = (0.75, 0.73, 0.68)
    sky_rgb: Rgb = (0.36, 0.55, 0.85)
    haze_rgb: Rgb = (0.80, 0.86, 0.92)
    margin_m: float = 2.5
    """Distance that people keep from the arena's edge."""

    def everything(self, *, obstacles: bool) -> tuple[Thing, ...]:
        """Return all objects in and around the arena."""
        return (self.things if obstacles else ()) + self.surroundings

    def free_space(self, *, obstacles: bool, inset_m: float = 0.0) -> FreeSpace:
        """Return the free space of the arena, made `inset_m` smaller on each side."""
        solids = [
            solid
            for thing in self.everything(obstacles=obstacles)
            for solid in thing.solids(self.terrain.height(thing.x, thing.y))
        ]
        half_x, half_y = self.half_x_m - inset_m, self.half_y_m - inset_m
        return FreeSpace(half_x, half_y, solids, self.terrain.lowest_m)
