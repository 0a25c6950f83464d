"""The interface of training methods, and their shared representation loss."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Protocol

import torch
from torch import Tensor

from adatracker_deploy.learning import losses
from adatracker_deploy.learning.train.agent import Agent, Sequences
from adatracker_deploy.learning.train.settings import BURN_IN, TrainSettings


class Learner(Protocol):
    """A method at work on an agent."""

    agent: Agent

    def update(self, sequences: Sequences, number: int) -> Mapping[str, Tensor]:
        """Improve the agent once.

        Args:
            sequences: on the agent's device.
            number: of this update, from 0; with the settings' seed it fixes whatever is drawn.

        Returns:
            Scalars by name, for the curves; `loss` among them.
        """

    def state_dict(self) -> dict[str, Any]:
        """Return all that the next update depends on, as tensors and plain values."""

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Take up what `state_dict` returned."""


def counted(sequences: Sequences) -> Tensor:
    """Return (B, L), 1 where a step counts: it exists, and the policy's memory has filled."""
    warm = torch.arange(sequences.valid.shape[1], device=sequences.valid.device) >= BURN_IN
    return sequences.valid * torch.maximum(sequences.start[:, None], warm.float())


def representation_losses(
    agent: Agent, z: Tensor | None, sequences: Sequences, settings: TrainSettings
) -> dict[str, Tensor]:
    """Return ``L_rep``'s parts by name, without those that a variant leaves out."""
    parts: dict[str, Tensor] = {}
    if z is None or agent.heads is None or agent.dynamics is None:
        return parts
    weight = sequences.valid
    if "no-identification" not in settings.variants:
        rewards, heights = agent.heads(z)
        parts["reward"] = losses.reward_loss(rewards, sequences.rewards, weight)
        parts["height"] = losses.height_loss(heights, sequences.height_m, weight)
    if not {"no-identification", "no-dynamics"} & set(settings.variants):
        targets = losses.dynamics_targets(sequences.log_limits, sequences.lag_s, sequences.delay_s)
        parts["dynamics"] = losses.dynamics_loss(agent.dynamics(z), targets, weight)
    if "no-consistency" not in settings.variants:
        first = agent.config.history
        parts["consistency"] = losses.consistency_loss(z, sequences.start, weight, first)
    return parts
