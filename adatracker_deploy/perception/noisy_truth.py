"""A segmenter that adds a real segmenter's errors to a simulated camera's ground truth."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from adatracker_deploy.core.messages import Box
from adatracker_deploy.perception.segmenter import TruthSegmenter
from adatracker_deploy.sim.noise import NOISE, MaskNoise

if TYPE_CHECKING:
    from adatracker_deploy.core.messages import Frame, Observation
    from adatracker_deploy.sim.noise import NoiseLevel


class NoisyTruth:
    """Implements `Segmenter`; its noise follows the frames' times, so that a slow machine has no longer gaps.

    Args:
        level: how much noise.
        rate_hz: of the noise's steps, and of the camera where the machine keeps up.
        seed: of the noise; each trial's is the next.
    """

    needs_truth = True

    def __init__(self, level: NoiseLevel, rate_hz: float, seed: int = 0) -> None:
        self._settings = NOISE[level].at(rate_hz)
        self._rate_hz = rate_hz
        self._truth = TruthSegmenter()
        self._seed = seed
        self.reset()

    def reset(self) -> None:
        """Begin the next trial's noise."""
        self._noise = MaskNoise(self._settings, self._seed)
        self._seed += 1
        self._began_ns: int | None = None
        self._steps = 0

    def __call__(self, frame: Frame) -> Observation:
        """Return the ground truth with noise.

        Raises:
            PlatformError: the frame comes from a real camera.
        """
        seen = self._truth(frame)
        for _ in range(self._due(frame.t_ns)):
            mask, _ = self._noise(seen.mask)
        box = Box.of_mask(mask)
        return replace(seen, mask=mask, box=box, confidence=1.0 if box else 0.0)

    def _due(self, t_ns: int) -> int:
        """Return how many steps of the noise a frame of this time makes: one, and those that were missed."""
        if self._began_ns is None:
            self._began_ns = t_ns
        by_now = 1 + round((t_ns - self._began_ns) / 1e9 * self._rate_hz)
        due = max(1, by_now - self._steps)
        self._steps += due
        return due
