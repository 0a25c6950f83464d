"""Computes a camera's view: its vertical field, and the pitch that keeps a person at 2.5 m in it."""

from __future__ import annotations

import math

from adatracker_deploy.core.task import DESIRED_DISTANCE_M

_CHEST_M = 1.3
"""Height to be seen: the middle of a trunk. A level camera at 3 m sees it, at 90 degrees, and no legs."""
_INNER = 0.9
"""Within this share of half the field of view, by angle."""


def pitch_in_view_deg(pitch_deg: float, height_m: float, fov_deg: float, aspect: float = 1.0) -> float:
    """Return the pitch nearest to `pitch_deg` (positive down) that has a person's chest in view at 2.5 m.

    Args:
        pitch_deg: as wished.
        height_m: of the camera above the ground.
        fov_deg: horizontal field of view.
        aspect: height of the picture as a share of its width.
    """
    down_deg = math.degrees(math.atan2(height_m - _CHEST_M, DESIRED_DISTANCE_M))
    reach_deg = _INNER * vertical_fov_deg(fov_deg, aspect) / 2
    return min(max(pitch_deg, down_deg - reach_deg), down_deg + reach_deg)


def vertical_fov_deg(fov_deg: float, aspect: float) -> float:
    """Return a pinhole camera's vertical field of view; the arguments are those of `pitch_in_view_deg`."""
    return math.degrees(2.0 * math.atan(aspect * math.tan(math.radians(fov_deg) / 2.0)))
