"""Offline reinforcement learning that works here: the logged actions, imitated by how good they were.

Critics of the true state (`critics`), or of what a log measured, say how much better each executed action was
than their own policy's; the deployed policy, which sees masks, imitates the executed actions with the
exponential of that as a weight.
Peng et al., "Advantage-Weighted Regression" (2019); Nair et al., "AWAC" (2020). No label of an expert and no
new rollout enters: perturbed actions are left out by their advantage alone. The loss reaches all networks,
the representation losses too.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import torch
from torch import Tensor

from adatracker_deploy.learning.data import logged, state
from adatracker_deploy.learning.train.agent import Agent, Sequences
from adatracker_deploy.learning.train.critics import StateCritics
from adatracker_deploy.learning.train.method import Learner, Say, counted, imitate
from adatracker_deploy.learning.train.settings import TrainSettings

if TYPE_CHECKING:
    from adatracker_deploy.learning.data.dataset import Dataset

_SHARPNESS = 15.0
"""Beta: an action worth one spread more weighs e^15 times as much; 2 and 5 were worse."""
_MOST = 20.0
"""Largest weight."""
_RATE = 1e-3


class Awr(Learner):
    """Implements `Learner`.

    Attributes:
        critics: fitted by `prepare`.
    """

    def __init__(self, agent: Agent, settings: TrainSettings) -> None:
        self.agent = agent
        self._settings = settings
        columns = logged.COLUMNS if settings.logs else state.COLUMNS
        self.critics = StateCritics(columns).to(next(agent.parameters()).device)
        self._optimizer = torch.optim.Adam(agent.parameters(), lr=_RATE)

    def prepare(self, data: Dataset, say: Say) -> bool:
        """Fit the critics, once."""
        if self.critics.fitted:
            return False
        settings = self._settings
        say(f"fitting the critics to the {'measured' if settings.logs else 'true'} states")
        told = self.critics.fit(
            data, updates=settings.critic_updates, conservative=settings.conservative, seed=settings.seed
        )
        say(f"critics: {settings.critic_updates} updates, loss {told['critics']:.4f}")
        return True

    def update(self, sequences: Sequences, number: int) -> dict[str, Tensor]:
        """Take one step of Adam."""
        first = self._settings.rate or _RATE
        for group in self._optimizer.param_groups:
            group["lr"] = first * 0.5 * (1 + math.cos(math.pi * number / self._settings.updates))
        executed = sequences.actions[:, -sequences.valid.shape[1] :]
        advantage = self.critics.advantage(sequences.states, executed)
        weight = (_SHARPNESS * advantage).exp().clamp(max=_MOST)
        told = imitate(
            self.agent,
            self._optimizer,
            sequences,
            actions=executed,
            weight=counted(sequences) * weight,
            settings=self._settings,
        )
        return told | {"weight": (weight * counted(sequences)).sum() / counted(sequences).sum()}

    def state_dict(self) -> dict[str, Any]:
        """Return weights and Adam's moments."""
        return {
            "agent": self.agent.state_dict(),
            "critics": self.critics.state_dict(),
            "optimizer": self._optimizer.state_dict(),
        }

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Take up what `state_dict` returned."""
        self.agent.load_state_dict(state["agent"])
        self.critics.load_state_dict(state["critics"])
        self._optimizer.load_state_dict(state["optimizer"])
