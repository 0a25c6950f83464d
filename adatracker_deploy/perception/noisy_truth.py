"""The truth of a simulated camera, spoilt as a real segmenter's masks are."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from adatracker_deploy.messages import Box
from adatracker_deploy.perception.segmenter import TruthSegmenter
from adatracker_deploy.world.noise import NOISE, MaskNoise

if TYPE_CHECKING:
    from adatracker_deploy.messages import Frame, Observation
    from adatracker_deploy.world.noise import NoiseLevel


class NoisyTruth:
    """Implements `Segmenter`.

    Args:
        level: how much noise.
        rate_hz: of the camera.
        seed: of the noise; each trial's is the next.
    """

    needs_truth = True

    def __init__(self, level: NoiseLevel, rate_hz: float, seed: int = 0) -> None:
        self._settings = NOISE[level].at(rate_hz)
        self._truth = TruthSegmenter()
        self._seed = seed
        self.reset()

    def reset(self) -> None:
        """Begin the next trial's noise."""
        self._noise = MaskNoise(self._settings, self._seed)
        self._seed += 1

    def __call__(self, frame: Frame) -> Observation:
        """Return the truth, spoilt.

        Raises:
            PlatformError: the frame comes from a real camera.
        """
        seen = self._truth(frame)
        mask, _ = self._noise(seen.mask)
        box = Box.of_mask(mask)
        return replace(seen, mask=mask, box=box, confidence=1.0 if box else 0.0)
