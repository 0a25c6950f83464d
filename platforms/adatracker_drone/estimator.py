"""What the vehicle believes of its own motion: the truth with a biased, noisy velocity and a noisy position.

A real estimator's velocity is off by a slowly changing amount, and a vehicle that is flown by velocity alone
drifts by it. Here the amount is constant and drawn from the seed, so that every rehearsal shows the drift.
"""

from __future__ import annotations

import numpy as np

from adatracker_drone.motion import Motion
from adatracker_drone.settings import SitlSettings


class Estimator:
    """One vehicle's estimation errors. Deterministic by seed."""

    def __init__(self, settings: SitlSettings, seed: int) -> None:
        self._settings = settings
        self._random = np.random.default_rng([seed, 0xE57])
        size = settings.velocity_bias_m_s * self._random.uniform(0.5, 1.0, 3)
        bias = size * self._random.choice([-1.0, 1.0], 3)
        self.bias_m_s: tuple[float, float, float] = (float(bias[0]), float(bias[1]), float(bias[2]))
        """Estimated minus true velocity: north, east, down."""

    def measure(self, truth: Motion) -> Motion:
        """Return one estimate; each call draws fresh noise."""
        place = self._settings.position_noise_m * self._random.standard_normal(3)
        speed = self._settings.velocity_noise_m_s * self._random.standard_normal(3) + self.bias_m_s
        return truth._replace(
            north=truth.north + float(place[0]),
            east=truth.east + float(place[1]),
            down=truth.down + float(place[2]),
            v_north=truth.v_north + float(speed[0]),
            v_east=truth.v_east + float(speed[1]),
            v_down=truth.v_down + float(speed[2]),
        )
