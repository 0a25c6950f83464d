"""Registers the task's Gymnasium environments when imported (needs the train extra).

``gymnasium.make("adatracker_deploy.gym:AdaTrackerClean-v0")`` imports this module: Gymnasium has loaded no
plugins since version 1.0. An environment's own module is imported when it is first made.

``UnrealTrack-MAP-ContinuousMask-v0`` and ``UnrealTrack-MAP-ContinuousColor-v0`` are gym-unrealcv's names of
UnrealZoo's maps. They take ``server="HOST:PORT"`` and ``settings="FILE"`` (docs/unreal.md) and have the
spaces, the rules and the bodies of this package.
"""

from __future__ import annotations

import gymnasium

from adatracker_deploy.learning.conditions import CONDITIONS
from adatracker_deploy.sim.unreal.maps import MAPS

_ENTRY_POINT = "adatracker_deploy.learning.environment:TrackingEnv"
_UNREAL = "adatracker_deploy.learning.environment:unreal_env"

gymnasium.register("AdaTracker-v0", _ENTRY_POINT)
for _name in CONDITIONS:
    gymnasium.register(f"AdaTracker{_name.capitalize()}-v0", _ENTRY_POINT, kwargs={"condition": _name})
for _name in MAPS:
    for _seen, _observe in (("Mask", "mask"), ("Color", "rgb")):
        _kwargs = {"level": _name, "observe": _observe}
        gymnasium.register(f"UnrealTrack-{_name}-Continuous{_seen}-v0", _UNREAL, kwargs=_kwargs)
