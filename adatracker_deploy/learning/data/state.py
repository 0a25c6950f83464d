"""The true state of a step as a row of numbers, for critics; policies never see it."""

from __future__ import annotations

import math
from collections import deque
from typing import TYPE_CHECKING

import numpy as np

from adatracker_deploy.core.geometry import wrap_angle
from adatracker_deploy.core.task import DESIRED_DISTANCE_M, MAX_LOST_STEPS
from adatracker_deploy.learning.episode_spec import RATE_HZ

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from adatracker_deploy.learning.embodiment import Embodiment
    from adatracker_deploy.learning.tracking import Tracking

REMEMBERED = 4
"""Last actions in a state: what a body with 0.4 s of delay has not obeyed yet."""
ACTION_COLUMNS = tuple(f"{axis}_{age}" for age in range(1, REMEMBERED + 1) for axis in ("forward", "yaw"))
"""Newest first."""
COLUMNS = (
    *("ahead_m", "left_m", "too_far_m", "bearing_rad"),  # the target, in the body frame
    *("target_ahead_m_s", "target_left_m_s"),  # its velocity, in the body frame
    *("forward_m_s", "yaw_rate_rad_s"),  # the body's own
    *("height_m", "pitch_deg", "fov_deg"),
    *("log_forward", "log_backward", "log_yaw", "lag_s", "delay_s"),
    *("lost", "visible"),  # consecutive lost steps as a share of those that end an episode; the last step's
    *ACTION_COLUMNS,
)
_SLOWEST_M_S = 0.05
"""A body that cannot drive backward has a logarithm, too."""


class StateColumns:
    """Follows one episode and describes each of its steps."""

    def __init__(self, tracking: Tracking) -> None:
        self._tracking = tracking
        self._target = tracking.task.world.target_xy
        self._velocity = (0.0, 0.0)
        self._lost, self._visible = 0, True
        self._actions: deque[tuple[float, float]] = deque([(0.0, 0.0)] * REMEMBERED, maxlen=REMEMBERED)

    def stepped(self, action: NDArray[np.float32], visible: bool) -> None:
        """Take note of a step that was made: the executed action (2,), and whether the target was visible."""
        x, y = self._tracking.task.world.target_xy
        self._velocity = ((x - self._target[0]) * RATE_HZ, (y - self._target[1]) * RATE_HZ)
        self._target = (x, y)
        self._lost, self._visible = 0 if visible else self._lost + 1, visible
        self._actions.appendleft((float(action[0]), float(action[1])))

    def row(self) -> NDArray[np.float32]:
        """Return the state now, float32 of shape (len(COLUMNS),), in the units that `COLUMNS` name."""
        body = self._tracking.task.body
        pose, own = body.pose, body.velocity
        east, north = self._target[0] - pose.x, self._target[1] - pose.y
        cos, sin = math.cos(pose.yaw), math.sin(pose.yaw)
        vx, vy = self._velocity
        values = (
            *(east * cos + north * sin, north * cos - east * sin),
            *(math.hypot(east, north) - DESIRED_DISTANCE_M, wrap_angle(math.atan2(north, east) - pose.yaw)),
            *(vx * cos + vy * sin, vy * cos - vx * sin),
            *(own.vx, own.yaw_rate),
            *described(self._tracking.embodiment),
            *(self._lost / MAX_LOST_STEPS, float(self._visible)),
            *(value for action in self._actions for value in action),
        )
        return np.array(values, np.float32)


def described(body: Embodiment) -> tuple[float, ...]:
    """Return a body's columns, from ``height_m`` to ``delay_s``."""
    return (
        *(body.height_m, body.pitch_deg, body.fov_deg),
        math.log(body.forward_m_s),
        math.log(max(body.backward_m_s, _SLOWEST_M_S)),
        math.log(body.yaw_rate_rad_s),
        *(body.lag_s, body.delay_s),
    )
