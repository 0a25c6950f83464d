"""Models the errors of a real segmenter: dropped frames, ragged edges, false blobs, latency."""

from __future__ import annotations

import functools
from collections import deque
from dataclasses import dataclass, replace
from typing import Annotated, Literal, Self

import cv2
import numpy as np
from numpy.typing import NDArray

from adatracker_deploy.config.schema import Range
from adatracker_deploy.core.messages import ClassMask, MaskClass

Probability = Annotated[float, Range(0, 1)]
NoiseLevel = Literal["none", "field", "hard", "embedded"]
STEP_HZ = 10.0
"""Step rate, Hz, for which rates and times are stated."""

_PATTERNS = 32
"""Number of fixed patterns of displaced pixels from which ragged edges are drawn: one lookup per frame."""
_RAGGED_WIDTH = 64
"""Width of the masks for which edges' displacements are stated, px: that of a policy's."""


@dataclass(frozen=True, slots=True, kw_only=True)
class NoiseSettings:
    """Rates per step at 10 Hz; times are in steps."""

    dropped: Probability = 0.0
    """Share of frames that never arrive, singly or in short runs."""
    mean_drop: Annotated[float, Range(1, 50)] = 1.5
    """Mean length of a run of dropped frames."""
    empty_share: Probability = 0.5
    """Share of dropped runs in which the mask is empty; in the others the last one is repeated."""
    blackouts: Probability = 0.0
    """Probability per step that the target vanishes from the mask for `blackout` steps: an occlusion."""
    blackout: tuple[int, int] = (10, 25)
    """Shortest and longest blackout."""
    ragged_px: Annotated[float, Range(0, 8)] = 0
    """Largest displacement of edges in masks 64 px wide, px, and in proportion in wider ones; of a fraction,
    the fewer are displaced by one."""
    blobs: Probability = 0.0
    """Probability per step that a false blob appears."""
    mean_blob: Annotated[float, Range(1, 100)] = 4.0
    """Mean life of a blob."""
    latency: tuple[int, int] = (0, 0)
    """Smallest and largest age of a mask; one age is drawn per episode."""

    def at(self, rate_hz: float) -> NoiseSettings:
        """Return the same noise, per second, for masks at `rate_hz`."""
        steps = rate_hz / STEP_HZ

        def longer(length: int) -> int:
            return round(length * steps)

        return replace(
            self,
            mean_drop=max(1.0, self.mean_drop * steps),
            blackouts=min(1.0, self.blackouts / steps),
            blackout=(longer(self.blackout[0]), longer(self.blackout[1])),
            blobs=min(1.0, self.blobs / steps),
            mean_blob=max(1.0, self.mean_blob * steps),
            latency=(longer(self.latency[0]), longer(self.latency[1])),
        )


NOISE: dict[NoiseLevel, NoiseSettings] = {
    "none": NoiseSettings(),
    "field": NoiseSettings(dropped=0.05, ragged_px=1, blobs=0.04),
    "hard": NoiseSettings(
        dropped=0.08, mean_drop=2.5, ragged_px=2, blobs=0.08, blackouts=0.01, latency=(0, 1)
    ),
    "embedded": NoiseSettings(
        dropped=0.036,
        mean_drop=3.7,
        empty_share=1.0,
        blackouts=0.0018,
        blackout=(13, 37),
        ragged_px=0.22,
        blobs=0.055,
        mean_blob=10.0,
        latency=(0, 1),
    ),
}
"""By name. `field` has the 5 % dropped frames of the conditions' definition. `embedded` is what the embedded
segmenter and the target lock make of PETS09-S2L1 (19 people, 664 s, `benchmarks/perception.py --noise`): of
the frames with the target 3.6 % lack its box in runs of up to 1 s, 0.37 s long on average; 12 longer runs of
1.3 s to 6.7 s, 2.4 s on average, and one of 15 s; 0.19 false people per frame. Those frames have no true
masks; the edges are those of rendered worlds (`benchmarks/mask_noise.py`, mask IoU 0.869 in masks of 64 px),
where the target is missed ten times more seldom and false people are three times as many. The classes of
blobs are not fitted."""

_BLOB_CLASSES = (MaskClass.BACKGROUND, MaskClass.TARGET, MaskClass.PERSON, MaskClass.OBSTACLE)
_BLOB_SHARES = (0.3, 0.1, 0.3, 0.3)
"""Shares of holes and of false blobs of each class; a target lock lets few of the target's class through."""


@dataclass(frozen=True, slots=True)
class _Blob:
    centre: tuple[int, int]
    axes: tuple[int, int]
    angle_deg: float
    value: int
    until: int


class MaskNoise:
    """Adds noise to one episode's masks, in order; the first, on which the target is locked, is left
    clean."""

    def __init__(self, settings: NoiseSettings, seed: int) -> None:
        self.settings = settings
        self._rng = np.random.default_rng([seed, 0x4E01])
        low, high = settings.latency
        self._waiting: deque[ClassMask] = deque(maxlen=1 + int(self._rng.integers(low, high + 1)))
        self._step = -1
        self._last: ClassMask | None = None
        self._drop_until = self._blackout_until = 0
        self._drop_empty = False
        self._blobs: list[_Blob] = []

    @classmethod
    def of_level(cls, level: NoiseLevel, seed: int) -> Self:
        """Return the noise of a named level."""
        return cls(NOISE[level], seed)

    def __call__(self, mask: ClassMask) -> tuple[ClassMask, bool]:
        """Return the mask that arrives at the step of `mask`, (H, W), and whether a frame was lost.

        The returned mask is not written to again.
        """
        self._step += 1
        self._waiting.append(mask)
        if self._last is None:
            self._last = mask
            return mask, False
        if self._dropped():
            return (np.zeros_like(mask) if self._drop_empty else self._last), True
        self._last = self._spoilt(self._waiting[0])
        return self._last, False

    def _dropped(self) -> bool:
        s = self.settings
        if self._step >= self._drop_until and s.dropped:
            # Runs begin often enough for their steps to make up the requested share.
            begins = s.dropped / (s.mean_drop * (1.0 - s.dropped) + s.dropped)
            if self._rng.random() < begins:
                self._drop_until = self._step + int(self._rng.geometric(1.0 / s.mean_drop))
                self._drop_empty = bool(self._rng.random() < s.empty_share)
        return self._step < self._drop_until

    def _spoilt(self, mask: ClassMask) -> ClassMask:
        s = self.settings
        if s.ragged_px:
            patterns = _ragged(*mask.shape, s.ragged_px)
            mask = mask.reshape(-1)[patterns[int(self._rng.integers(_PATTERNS))]]
        if self._blacked_out():
            mask = np.where(mask == MaskClass.TARGET, np.uint8(MaskClass.BACKGROUND), mask)
        if s.blobs:
            mask = self._with_blobs(mask)
        return mask

    def _blacked_out(self) -> bool:
        s = self.settings
        if s.blackouts and self._step >= self._blackout_until and self._rng.random() < s.blackouts:
            low, high = s.blackout
            self._blackout_until = self._step + int(self._rng.integers(low, high + 1))
        return self._step < self._blackout_until

    def _with_blobs(self, mask: ClassMask) -> ClassMask:
        self._blobs = [blob for blob in self._blobs if self._step < blob.until]
        if self._rng.random() < self.settings.blobs:
            self._blobs.append(self._new_blob(mask.shape))
        if not self._blobs:
            return mask
        painted = mask.copy()
        for blob in self._blobs:
            cv2.ellipse(painted, blob.centre, blob.axes, blob.angle_deg, 0, 360, blob.value, -1)
        return painted

    def _new_blob(self, shape: tuple[int, ...]) -> _Blob:
        height, width = shape
        rng = self._rng
        value = int(rng.choice(_BLOB_CLASSES, p=_BLOB_SHARES))
        largest = width / (16 if value == MaskClass.TARGET else 8)
        across, along = rng.uniform(1.0, largest, 2)
        return _Blob(
            centre=(int(rng.integers(width)), int(rng.integers(height))),
            axes=(round(across), round(along)),
            angle_deg=float(rng.uniform(0, 180)),
            value=value,
            until=self._step + int(rng.geometric(1.0 / self.settings.mean_blob)),
        )


@functools.lru_cache(maxsize=8)
def _ragged(height: int, width: int, reach_px: float) -> NDArray[np.intp]:
    """Return, per pattern and pixel, the index of the pixel to take its class from: (P, H, W), read-only.

    Displacements are smooth over about four pixels, so that edges are ragged, not speckled. Both are pixels
    of a mask 64 px wide.
    """
    rng = np.random.default_rng(0)
    rows, columns = np.mgrid[:height, :width]
    scale = width / _RAGGED_WIDTH
    nodes = 2, int(height / scale) // 4 + 2, _RAGGED_WIDTH // 4 + 2
    patterns = []
    for _ in range(_PATTERNS):
        coarse = rng.uniform(-reach_px - 0.5, reach_px + 0.5, nodes)
        moved = [
            np.rint(scale * np.rint(cv2.resize(field, (width, height), interpolation=cv2.INTER_CUBIC)))
            for field in coarse
        ]
        row = np.clip(rows + moved[0], 0, height - 1).astype(np.intp)
        column = np.clip(columns + moved[1], 0, width - 1).astype(np.intp)
        patterns.append(row * width + column)
    table = np.array(patterns)
    table.flags.writeable = False
    return table
