"""The task's Gymnasium environments, by name; importing this module registers them (needs the train extra).

``gymnasium.make("adatracker_deploy.gym:AdaTrackerClean-v0")`` imports it by itself: Gymnasium has loaded no
plugins since its version 1.0. An environment's own module is imported when one is made.
"""

from __future__ import annotations

import gymnasium

from adatracker_deploy.learning.conditions import CONDITIONS

_ENTRY_POINT = "adatracker_deploy.learning.environment:TrackingEnv"

gymnasium.register("AdaTracker-v0", _ENTRY_POINT)
for _name in CONDITIONS:
    gymnasium.register(f"AdaTracker{_name.capitalize()}-v0", _ENTRY_POINT, kwargs={"condition": _name})
