"""Drivers: what remembers and acts in a policy; bodies that obey late may have one of their own.

Ours, not the paper's, but for the actor. B is the batch, T a length in time, H a memory's width, A the number
of an action's axes.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import torch
from torch import Tensor, nn
from torch.nn import functional

from adatracker_deploy.policy import response

if TYPE_CHECKING:
    from adatracker_deploy.learning.networks import AdaTrackerConfig

LstmState = tuple[Tensor, Tensor]
"""(h, c) of a one-layer LSTM, each (1, B, H); zeros begin an episode."""


class Actor(nn.Module):
    """A Gaussian over actions before tanh, from the policy's recurrent feature."""

    def __init__(self, features: int, width: int, actions: int) -> None:
        super().__init__()
        self.hidden = nn.Linear(features, width)
        self.mean = nn.Linear(width, actions)
        self.log_std = nn.Linear(width, actions)

    def forward(self, x: Tensor) -> tuple[Tensor, Tensor]:
        """Return (mean, log_std), each (..., A); log_std in [-5, 2], the range common to SAC."""
        x = functional.relu(self.hidden(x))
        return self.mean(x), self.log_std(x).clamp(-5.0, 2.0)


_LATE_FROM_S, _LATE_WHOLLY_S = 1.35, 1.5
"""Delay and lag together, as the response has them, from which the second driver counts, and alone counts.

In none of 16 tuning episodes of `field` was it told of 1.1 s, so there is one driver there; with 0.6 and 1 s,
it was told of more than 1.2 s in 90 to 98 % of the steps.
"""


class Memories(nn.Module):
    """The LSTMs of two drivers, the usual one and one for bodies that obey late.

    With 1.6 s between a command and its work, another way to drive is right, and one network that learns it
    forgets some of the other (`docs/learning.md`). Both remember at all times, so either can take over.
    """

    def __init__(self, inputs: int, config: AdaTrackerConfig) -> None:
        super().__init__()
        self.usual = nn.LSTM(inputs, config.hidden, batch_first=True)
        self.late = nn.LSTM(inputs, config.hidden, batch_first=True)
        told = config.features + config.context
        self._delay, self._lag = (told + response.COLUMNS.index(name) for name in ("delay", "lag"))

    def forward(self, u: Tensor, state: LstmState | None = None) -> tuple[Tensor, LstmState]:
        """Return (x, state) of inputs u (B, T, U).

        Args:
            u: see `ContextPolicy.inputs`.
            state: (h, c), each (1, B, 2H), the usual driver's first; zeros if None.

        Returns:
            x (B, T, 2H + 1): what each driver knows, and the late one's share, 0 to 1; and the state after.
        """
        usual, late = self.usual(u, _half(state, 0)), self.late(u, _half(state, 1))
        late_s = response.LONGEST_DELAY_S * u[..., self._delay, None] + u[..., self._lag, None]
        share = ((late_s - _LATE_FROM_S) / (_LATE_WHOLLY_S - _LATE_FROM_S)).clamp(0.0, 1.0)
        h, c = (torch.cat(parts, dim=-1) for parts in zip(usual[1], late[1], strict=True))
        return torch.cat((usual[0], late[0], share), dim=-1), (h, c)


def _half(state: LstmState | None, which: int) -> LstmState | None:
    if state is None:
        return None
    h, c = (part.chunk(2, dim=-1)[which].contiguous() for part in state)
    return h, c


class Actors(nn.Module):
    """The actors of two drivers, and what comes of both, by the late one's share."""

    def __init__(self, config: AdaTrackerConfig) -> None:
        super().__init__()
        self._hidden = config.hidden
        self.usual = Actor(config.hidden, config.actor, config.actions)
        self.late = Actor(config.hidden, config.actor, config.actions)

    def forward(self, x: Tensor) -> tuple[Tensor, Tensor]:
        """Return (mean, log_std), each (..., A), of what `Memories` returns."""
        usual, late, share = torch.split(x, [self._hidden, self._hidden, 1], dim=-1)
        both = zip(self.usual(usual), self.late(late), strict=True)
        mean, log_std = ((1.0 - share) * one + share * other for one, other in both)
        return mean, log_std


def memory_of(config: AdaTrackerConfig) -> Memories | nn.LSTM | nn.Linear:
    """Return what a policy remembers with, a layer without memory where it has none."""
    inputs = sum(config.inputs.values())
    if config.second_driver:
        return Memories(inputs, config)
    if config.lstm:
        return nn.LSTM(inputs, config.hidden, batch_first=True)
    return nn.Linear(inputs, config.hidden)


def actor_of(config: AdaTrackerConfig) -> Actors | Actor:
    """Return what acts on what a policy remembers."""
    return Actors(config) if config.second_driver else Actor(config.hidden, config.actor, config.actions)
