"""DAgger: clones the expert's clean action, on states of the perturbed expert and then of the agent.

Ours, not the paper's: it asks the expert about visited states, so it is online imitation. Ross, Gordon and
Bagnell, "A Reduction of Imitation Learning and Structured Prediction to No-Regret Online Learning" (AISTATS
2011). Which states there are is the run's business; this is the update.
"""

from __future__ import annotations

import math
from typing import Any

import torch
from torch import Tensor

from adatracker_deploy.learning.data.visit import DAGGER, Company
from adatracker_deploy.learning.train.agent import Agent, Sequences
from adatracker_deploy.learning.train.method import Learner, counted, imitate
from adatracker_deploy.learning.train.settings import TrainSettings

_RATE = 1e-3
_LAST_RATE = 2e-5
_DECAY_FROM = 0.5
"""Share of the run after which the learning rate falls, along a cosine, to the last one."""


class Dagger(Learner):
    """Implements `Learner`."""

    visits: Company | None = DAGGER

    def __init__(self, agent: Agent, settings: TrainSettings) -> None:
        self.agent = agent
        self._settings = settings
        self._optimizer = torch.optim.Adam(agent.parameters(), lr=_RATE)

    def update(self, sequences: Sequences, number: int) -> dict[str, Tensor]:
        """Take one step of Adam."""
        for group in self._optimizer.param_groups:
            group["lr"] = learning_rate(number / self._settings.updates, self._settings.rate or _RATE)
        return imitate(
            self.agent,
            self._optimizer,
            sequences,
            actions=self._wanted(sequences),
            weight=counted(sequences),
            settings=self._settings,
        )

    def _wanted(self, sequences: Sequences) -> Tensor:
        """Return the actions to imitate, (B, L, A)."""
        return sequences.experts

    def state_dict(self) -> dict[str, Any]:
        """Return weights and Adam's moments."""
        return {"agent": self.agent.state_dict(), "optimizer": self._optimizer.state_dict()}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Take up what `state_dict` returned."""
        self.agent.load_state_dict(state["agent"])
        self._optimizer.load_state_dict(state["optimizer"])


def learning_rate(done: float, first: float = _RATE) -> float:
    """Return the learning rate when a share `done` of the run lies behind and it began with `first`."""
    falling = max(0.0, (done - _DECAY_FROM) / (1.0 - _DECAY_FROM))
    last = min(_LAST_RATE, first)
    return last + (first - last) * 0.5 * (1.0 + math.cos(math.pi * falling))
