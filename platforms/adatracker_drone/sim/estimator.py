"""The vehicle's state estimate: ground truth plus a slowly varying error and noise.

A real estimator's velocity is off by a slowly changing amount, and a vehicle that is flown by velocity alone
drifts by it. Part of it is constant here and drawn from the seed, so that every rehearsal shows the drift.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from adatracker_drone.sim.motion import Motion
from adatracker_drone.sim.settings import SitlSettings

_WANDER_S, _DRIFT_S = 5.0, 20.0
"""Correlation times of the velocity's and of the height's error."""
_WORST_M_S, _WORST_M = 0.8, 0.7
"""The largest that a real PX4 had in hours of simulated flight."""


class Estimator:
    """One vehicle's estimation errors. Deterministic by seed."""

    def __init__(self, settings: SitlSettings, seed: int) -> None:
        self._settings = settings
        self._random = np.random.default_rng([seed, 0xE57])
        size = settings.velocity_bias_m_s * self._random.uniform(0.5, 1.0, 3)
        self._bias = size * self._random.choice([-1.0, 1.0], 3)
        self._wander = np.zeros(3)
        self._drift_m = 0.0
        """Estimated minus true down."""
        self.error_m_s = _within(self._bias, _WORST_M_S)
        """Estimated minus true velocity, without its noise: north, east, down."""

    def measure(self, truth: Motion, dt_s: float) -> Motion:
        """Return one estimate `dt_s` after the last; each call draws fresh noise."""
        settings, random = self._settings, self._random
        self._wander += _kick(settings.velocity_wander_m_s, _WANDER_S, dt_s) * random.standard_normal(3)
        self._wander *= 1 - dt_s / _WANDER_S
        self.error_m_s = _within(self._bias + self._wander, _WORST_M_S)
        self._drift_m += _kick(settings.height_drift_m, _DRIFT_S, dt_s) * float(random.standard_normal())
        self._drift_m *= 1 - dt_s / _DRIFT_S
        self._drift_m = min(max(self._drift_m, -_WORST_M), _WORST_M)
        place = settings.position_noise_m * random.standard_normal(3)
        speed = settings.velocity_noise_m_s * random.standard_normal(3) + self.error_m_s
        return truth._replace(
            north=truth.north + float(place[0]),
            east=truth.east + float(place[1]),
            down=truth.down + self._drift_m + float(place[2]),
            v_north=truth.v_north + float(speed[0]),
            v_east=truth.v_east + float(speed[1]),
            v_down=truth.v_down + float(speed[2]),
        )


def _kick(deviation: float, correlation_s: float, dt_s: float) -> float:
    """Return the step of an Ornstein-Uhlenbeck process with this standard deviation."""
    return deviation * math.sqrt(2 * dt_s / correlation_s)


def _within(vector: NDArray[np.float64], most: float) -> tuple[float, float, float]:
    north, east, down = (min(max(float(each), -most), most) for each in vector)
    return north, east, down
