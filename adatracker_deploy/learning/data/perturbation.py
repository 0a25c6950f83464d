"""Perturbs the expert, so that its data show recoveries: the paper's multi-level perturbation.

Each episode has a level, from none to strong. The executed action is the expert's plus noise that is
correlated in time; at higher levels it is now and then left out, replaced by a random one that is held, or
by a random walk for some seconds. A recipe may have this come in bouts, between which the expert drives by
itself: then the executed actions show how to recover. Its own action is stored beside as the label.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from adatracker_deploy.learning.episode_spec import RATE_HZ

LEVELS = (0.0, 0.1, 0.25, 0.5, 1.0)
"""An episode's level is one of these, each as likely."""

_CORRELATION_S = 0.6
_STD = 0.6
"""Standard deviation of the noise at level 1, in units of an action."""
_DROPOUT_PER_S = 0.3
_BURST_PER_S = 0.2
_WALK_PER_S = 0.05
"""Rates at level 1; they grow with the level."""
_DROPOUT_STEPS = (1, 5)
_BURST_STEPS = (3, 9)
_WALK_STEPS = (15, 40)
_BOUT_S = 1.5
"""Mean length of a bout."""


class Perturbation:
    """One episode's; call it once a step."""

    def __init__(self, rng: np.random.Generator, level: float, share: float = 1.0) -> None:
        """Take a level from 0, which changes nothing, to 1, and the share of the time that has it."""
        self._rng = rng
        self._level = level
        self._share = share
        self._calm = False
        self._noise = level * _STD * rng.standard_normal(2)
        self._kind = "none"
        self._left = 0
        self._held = np.zeros(2)

    @classmethod
    def drawn(cls, seed: int, share: float = 1.0, levels: tuple[float, ...] = LEVELS) -> Perturbation:
        """Return an episode's, its level drawn."""
        rng = np.random.default_rng([seed, 0x9E47])
        return cls(rng, levels[int(rng.integers(len(levels)))], share)

    def __call__(self, action: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return the perturbed action to execute, shape (2,), in [-1, 1]."""
        if self._level == 0.0:
            return action
        keep = math.exp(-1.0 / (RATE_HZ * _CORRELATION_S))
        fresh = self._level * _STD * math.sqrt(1.0 - keep**2)
        self._noise = keep * self._noise + fresh * self._rng.standard_normal(2)
        if self._share < 1.0 and self._is_calm():
            return action
        executed = self._interrupted(action + self._noise)
        return np.clip(executed, -1.0, 1.0).astype(np.float32)

    def _is_calm(self) -> bool:
        """Return whether the expert drives by itself in this step; bouts and pauses end at random."""
        pause_s = _BOUT_S * (1.0 - self._share) / self._share
        if self._rng.random() * RATE_HZ < 1.0 / (pause_s if self._calm else _BOUT_S):
            self._calm = not self._calm
        return self._calm

    def _interrupted(self, action: NDArray[np.float64]) -> NDArray[np.float64]:
        if self._left == 0:
            self._begin()
        if self._left == 0:
            return action
        self._left -= 1
        if self._kind == "walk":
            self._held = np.clip(self._held + 0.25 * self._rng.standard_normal(2), -1.0, 1.0)
        return self._held

    def _begin(self) -> None:
        chance = self._rng.random() * RATE_HZ / self._level
        for kind, rate, (low, high) in (
            ("dropout", _DROPOUT_PER_S, _DROPOUT_STEPS),
            ("burst", _BURST_PER_S, _BURST_STEPS),
            ("walk", _WALK_PER_S, _WALK_STEPS),
        ):
            if chance < rate:
                self._kind, self._left = kind, int(self._rng.integers(low, high + 1))
                self._held = np.zeros(2) if kind == "dropout" else self._rng.uniform(-1.0, 1.0, 2)
                return
            chance -= rate
