"""Seed ranges that keep training, tuning and evaluation apart.

A seed fixes an episode's world, body and noise. Nothing trained or tuned sees an evaluation seed.
"""

from __future__ import annotations

import numpy as np

TRAINING = range(900_000)
"""Collected episodes."""
TUNING = range(900_000, 1_000_000)
"""Choices made by looking at scores: the expert's gains, hyperparameters, early stopping."""
FIRST_EVALUATION = 1_000_000
"""Scores that are reported use this seed or later ones."""


def training_seed(run: int, shard: int, episode: int) -> int:
    """Return the seed of one collected episode, the same for the same place in the same run."""
    word = np.random.SeedSequence([run, shard, episode]).generate_state(1)[0]
    return TRAINING[int(word) % len(TRAINING)]
