"""Search: what a policy with a belief does once its target may have left the view.

A full turn to the side of the last sight finds whoever is near, but a clone hesitates: in most gaps the
target is hidden or missing in the mask, and in the middle of the picture when it comes back. What tells them
apart is how far the target can have come: the angular speed that it usually had, times the time since. At
0.5 m/s that takes some 4 s, at 3 m/s 1.3 s. From then on the policy's own answer is replaced, if its manifest
says so, until the target is seen again. Ours, not the paper's.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from adatracker_deploy.policy.belief import STATE, Array

if TYPE_CHECKING:
    from adatracker_deploy.policy.base import ActionSpec

STRAYED_RAD = 1.5
"""Usual angular speed times gap from which on it searches. Of 1, 1.25, 1.5 and 1.75 on tuning episodes of
`hard`, this lost the fewest targets, and no reward (`docs/learning.md`)."""


def search_yaw(state: Array) -> Array:
    """Return the yaw, a fraction of its limit, with which to search: 1 left, -1 right, 0 there is no need.

    Args:
        state: the belief's, (..., `len(belief.STATE)`).
    """
    at = {name: state[..., STATE.index(name)] for name in ("seen", "gap_s", "left", "width", "usual_rad_s")}
    ever = at["width"] > 0
    strayed = at["gap_s"] * at["usual_rad_s"] >= STRAYED_RAD
    side = np.where(at["left"] < 0, np.float32(-1), np.float32(1))
    return np.where(ever & (at["seen"] == 0) & strayed, side, np.float32(0))


def with_search(values: Array, yaw: Array, action: ActionSpec) -> Array:
    """Return a policy's actions (..., A), with the search in their place where `yaw` (...) is not 0.

    Args:
        values: the policy's own; what is not finite stays, so that a broken network is not hidden.
        yaw: see `search_yaw`.
        action: their axes.
    """
    signs = np.array([entry.sign if entry.axis == "yaw" else 0 for entry in action], np.float32)
    return np.where((yaw[..., None] != 0) & np.isfinite(values), yaw[..., None] * signs, values)
