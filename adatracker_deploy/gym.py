"""Registers the task's Gymnasium environments when imported (needs the train extra).

``gymnasium.make("adatracker_deploy.gym:AdaTrackerClean-v0")`` imports this module: Gymnasium has loaded no
plugins since version 1.0. An environment's own module is imported when it is first made.
"""

from __future__ import annotations

import gymnasium

from adatracker_deploy.learning.conditions import CONDITIONS

_ENTRY_POINT = "adatracker_deploy.learning.environment:TrackingEnv"

gymnasium.register("AdaTracker-v0", _ENTRY_POINT)
for _name in CONDITIONS:
    gymnasium.register(f"AdaTracker{_name.capitalize()}-v0", _ENTRY_POINT, kwargs={"condition": _name})
