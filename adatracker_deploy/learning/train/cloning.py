"""Behaviour cloning: imitates the executed actions, good or bad, without an expert and without a world."""

from __future__ import annotations

from torch import Tensor

from adatracker_deploy.learning.train.agent import Sequences
from adatracker_deploy.learning.train.dagger import Dagger


class Cloning(Dagger):
    """Implements `Learner`: `Dagger`'s update, towards what was done instead of what an expert wanted."""

    visits = None

    def _wanted(self, sequences: Sequences) -> Tensor:
        return sequences.actions[:, -sequences.valid.shape[1] :]
