"""The paper's five simulated scenes as geometric stand-ins, found by name."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.sim import layouts
from adatracker_deploy.sim.scene import Scene


@dataclass(frozen=True, slots=True)
class _Entry:
    build: Callable[[np.random.Generator], Scene]
    description: str


_SCENES = {
    "simple_room": _Entry(layouts.simple_room, "a walled room with a few boxes and columns"),
    "parking_lot": _Entry(layouts.parking_lot, "rows of parked cars and lamp posts"),
    "urban_city": _Entry(layouts.urban_city, "streets around a city block"),
    "urban_road": _Entry(layouts.urban_road, "a tree-lined road between houses"),
    "snow_village": _Entry(layouts.snow_village, "huts and firs on hilly, snowy ground"),
}


def scene_names() -> list[str]:
    """Return the names of the scenes, the paper's training scene first."""
    return list(_SCENES)


def describe_scenes() -> dict[str, str]:
    """Return a one-line description of each scene, by name."""
    return {name: entry.description for name, entry in _SCENES.items()}


def build_scene(name: str, rng: np.random.Generator) -> Scene:
    """Build a scene; `rng` draws what is random in it.

    Raises:
        UsageError: no scene has this name.
    """
    if name not in _SCENES:
        raise UsageError(f"unknown scene {name!r}: known are {', '.join(_SCENES)}")
    return _SCENES[name].build(rng)
