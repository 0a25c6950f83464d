"""Camera motion of a trot: bob, pitch, roll and uneven ground. Pure."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from adatracker_deploy.core.geometry import Pose

if TYPE_CHECKING:
    from adatracker_quadruped.sim.settings import GaitSettings

_HIP_X_M, _HIP_Y_M = 0.1934, 0.142
"""From the middle of the trunk to a foot below its hip: the Go2's, by its URDF (0.0465 + 0.0955 m aside)."""
_WHOLE_AT = 0.2
"""The share of the largest speed from which the gait has its whole amplitude."""
_START_S = 0.15
"""Time constant with which the gait's amplitude follows the speed."""
_LEFT = np.array([1.0, -1.0, 1.0, -1.0])
_FRONT = np.array([1.0, 1.0, -1.0, -1.0])
_PAIRS = ((0, 3), (1, 2))
"""Feet are front left, front right, rear left, rear right; diagonal ones step together."""


@dataclass(frozen=True, slots=True)
class Footfall:
    """The feet before and after the step that is being taken: heights, m, shape (4,)."""

    before: np.ndarray[tuple[int], np.dtype[np.float64]]
    after: np.ndarray[tuple[int], np.dtype[np.float64]]

    def at(self, share: float) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
        """Return the heights when this share of the step is done, 0 to 1."""
        smooth = share * share * (3.0 - 2.0 * share)
        return self.before + smooth * (self.after - self.before)


class Gait:
    """The trunk's motion above the ground that the body walks on.

    Args:
        settings: frequencies and amplitudes.
        random: draws the ground under each foot.
    """

    def __init__(self, settings: GaitSettings, random: np.random.Generator) -> None:
        self._settings = settings
        self._random = random
        self._cycles = 0.0
        self._amplitude = 0.0
        level = np.zeros(4)
        self._footfall = Footfall(level, level)

    def step(self, pace: float, dt_s: float) -> bool:
        """Go on for `dt_s` seconds; tell whether feet were put down.

        Args:
            pace: speed as a share of the largest, 0 to 1; at 0 the robot stands and its trunk comes to rest.
            dt_s: shorter than half a cycle.
        """
        settings = self._settings
        whole = min(1.0, pace / _WHOLE_AT)
        self._amplitude += (whole - self._amplitude) * (1.0 - math.exp(-dt_s / _START_S))
        if pace == 0.0:
            return False
        before = self._cycles
        self._cycles += dt_s * (settings.slow_hz + (settings.fast_hz - settings.slow_hz) * pace)
        if int(2 * self._cycles) == int(2 * before):
            return False
        pair = list(_PAIRS[int(2 * self._cycles) % 2])
        heights = self._footfall.after.copy()
        heights[pair] = settings.uneven_m * self._random.standard_normal(2)
        self._footfall = Footfall(self._footfall.after, heights)
        return True

    @property
    def trunk(self) -> Pose:
        """The trunk's motion: from where it stands on level ground to where it is now."""
        settings, phase = self._settings, math.tau * self._cycles
        feet = self._footfall.at(2 * self._cycles % 1.0)
        return Pose(
            z=-self._amplitude * settings.bob_m * math.cos(2 * phase) + float(feet.mean()),
            roll=self._amplitude * math.radians(settings.roll_deg) * math.sin(phase)
            + math.atan2(float(_LEFT @ feet) / 2, 2 * _HIP_Y_M),
            pitch=self._amplitude * math.radians(settings.pitch_deg) * math.sin(2 * phase)
            - math.atan2(float(_FRONT @ feet) / 2, 2 * _HIP_X_M),
        )
