"""An uneven road under a body, and how it tilts the body's camera. Pure but for its state.

ISO 8608 gives the power spectral density of a road's height over the spatial frequency n, in cycles a metre:
G(n) = G(n0) (n / n0)^-2 with n0 = 0.1. Such a height is a random walk over the way, and the difference of two
points L apart has the variance 2 pi^2 G(n0) n0^2 L.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from adatracker_deploy.core.geometry import Pose

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from adatracker_deploy.config.effects import RoadClass

ROUGHNESS_M3: dict[RoadClass, float] = {"smooth": 0.0, "A": 16e-6, "B": 64e-6, "C": 256e-6, "D": 1024e-6}
"""G(n0), the geometric mean of each class (ISO 8608, annex C)."""
_REFERENCE_PER_M = 0.1
WHEELBASE_M, TRACK_M = 0.5, 0.42
"""Wheelbase and track of a small ground robot."""
_STEP_M = 0.02


class Road:
    """The road under a body that stands on it with four wheels and has no springs.

    Args:
        road: its class.
        seed: of its bumps.
    """

    def __init__(self, road: RoadClass, seed: int) -> None:
        per_m = 2.0 * math.pi**2 * ROUGHNESS_M3[road] * _REFERENCE_PER_M**2
        self._bump_m = math.sqrt(per_m * _STEP_M)
        self._rng = np.random.default_rng([seed, 0x80AD])
        # ISO 8608 does not say how alike two tracks are. Here the mean of both tilts the body ahead, and a
        # profile across of the same kind tilts it aside.
        self._along = self._fresh(WHEELBASE_M)
        self._across = self._fresh(TRACK_M)
        self._left_m = 0.0
        self._place: tuple[float, float] | None = None

    def tilted(self, camera: Pose, robot: Pose) -> Pose:
        """Return the camera's pose as the road tilts it where the robot has come to."""
        if not self._bump_m:
            return camera
        last, self._place = self._place, (robot.x, robot.y)
        self._drive(0.0 if last is None else math.dist(last, self._place))
        pitch = math.atan(float(self._along.sum()) / WHEELBASE_M)
        roll = math.atan(float(self._across.sum()) / TRACK_M)
        return camera @ Pose(roll=roll, pitch=pitch)

    def _drive(self, way_m: float) -> None:
        """Roll over new bumps."""
        self._left_m += way_m
        steps = min(int(self._left_m / _STEP_M), 1000)
        self._left_m = math.fmod(self._left_m, _STEP_M)
        for _ in range(steps):
            for bumps in (self._along, self._across):
                bumps[:-1] = bumps[1:]
                bumps[-1] = self._bump_m * self._rng.standard_normal()

    def _fresh(self, long_m: float) -> NDArray[np.float64]:
        return self._bump_m * self._rng.standard_normal(round(long_m / _STEP_M))
