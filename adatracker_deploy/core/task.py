"""The paper's task: desired position, reward, and when the target counts as visible.

Source: AdaTracker, section "Experimental Setup", task setting and reward.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from adatracker_deploy.core.messages import Box

DESIRED_DISTANCE_M = 2.5
"""rho* of the task setting."""
MAX_DISTANCE_M = 7.5
"""rho_max: the reward's scale, and the largest distance at which a target counts as visible."""
MAX_BEARING_RAD = math.radians(45.0)
"""theta_max: the reward's scale, and half of the 90 degree field of view."""
MAX_LOST_STEPS = 50
"""This many consecutive lost steps end a trial."""
SIMULATOR_LOST_STEPS = MAX_LOST_STEPS + 1
"""The published simulator's code ends an episode at the 51st lost step,"""
SIMULATOR_LEAST_REWARD = -1.0
"""and lets no reward fall below -1."""
FIRST_SIGHT_S = 10.0
"""Longest search for the target, standing still, before the robot gives up; not the paper's."""


def step_reward(distance_m: float, bearing_rad: float) -> float:
    """Return the task's reward, 1 - |rho - 2.5| / 7.5 - |theta| / 45 deg: at most 1, unbounded below.

    Args:
        distance_m: horizontal distance to the target.
        bearing_rad: its bearing from the robot's heading, in (-pi, pi].
    """
    return 1.0 - abs(distance_m - DESIRED_DISTANCE_M) / MAX_DISTANCE_M - abs(bearing_rad) / MAX_BEARING_RAD


def box_reward(box: Box, reference: Box) -> float:
    """Return R = 1 / (1 + |c - c_ref| + |(w, h) - (w, h)_ref|), L2 norms of normalised boxes; in (0, 1]."""
    centre = math.hypot(box.cx - reference.cx, box.cy - reference.cy)
    size = math.hypot(box.w - reference.w, box.h - reference.h)
    return 1.0 / (1.0 + centre + size)


def is_box(box: Box) -> bool:
    """Return whether a box has finite numbers and a size."""
    return box.w > 0 and box.h > 0 and math.isfinite(box.cx + box.cy + box.w + box.h)


def target_visible(distance_m: float, bearing_rad: float, in_mask: bool) -> bool:
    """Return whether the target counts as visible in simulation: within 7.5 m and 90 degrees, and in the
    mask."""
    return in_mask and distance_m <= MAX_DISTANCE_M and abs(bearing_rad) <= MAX_BEARING_RAD
