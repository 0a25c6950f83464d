"""The interface of training methods, and their shared representation loss."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any, Protocol

import torch
from torch import Tensor, nn

from adatracker_deploy.core.errors import UsageError, line_of
from adatracker_deploy.learning import losses
from adatracker_deploy.learning.train.agent import Agent, Sequences
from adatracker_deploy.learning.train.settings import BURN_IN, TrainSettings

if TYPE_CHECKING:
    from adatracker_deploy.learning.data.dataset import Dataset
    from adatracker_deploy.learning.data.visit import Company

Say = Callable[[str], None]
"""Told in a line what happens now."""


class Learner(Protocol):
    """A method at work on an agent.

    Attributes:
        visits: how it visits states between its rounds of updates; None for a method that does not.
        reads_inputs: it leaves front and encoder as they are, and reads `Sequences.inputs` alone.
    """

    agent: Agent
    visits: Company | None = None
    reads_inputs: bool = False

    def prepare(self, data: Dataset, say: Say) -> bool:  # noqa: ARG002 - most methods need nothing
        """Do what the first update needs, once; return whether there was anything to do."""
        return False

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


_CLONING, _REPRESENTATION = 5.0, 0.3
"""Weights in the loss of imitation, a prototype's, whose cloning alone kept SR .96 in `field`."""
_CLIP = 1.0
"""Largest norm of the gradient."""


def check_bfloat16(device: str) -> None:
    """Compute a small LSTM in bfloat16.

    Raises:
        UsageError: the device cannot, as processors without AVX-512 cannot.
    """
    where = torch.device(device)
    try:
        with torch.random.fork_rng(), torch.autocast(where.type, torch.bfloat16):
            nn.LSTM(2, 2).to(where)(torch.zeros(1, 1, 2, device=where))
    except RuntimeError as error:
        why = line_of(error)
        raise UsageError(f"--bfloat16: device {device!r} cannot; leave it out ({why})") from error


def imitate(
    agent: Agent,
    optimizer: torch.optim.Optimizer,
    sequences: Sequences,
    *,
    actions: Tensor,
    weight: Tensor,
    settings: TrainSettings,
) -> dict[str, Tensor]:
    """Take one step towards actions (B, L, A), weighed by (B, L), with ``L_rep``; return the losses."""
    with torch.autocast(sequences.place.device.type, torch.bfloat16, enabled=settings.bfloat16):
        recalled = agent.recall(sequences)
        mean, _ = agent.policy.actor(recalled.x)
        parts = {"cloning": losses.cloning_loss(mean, actions, weight)}
        parts |= representation_losses(agent, recalled.z, sequences, settings)
    weights = {"cloning": _CLONING}
    loss = sum(
        (weights.get(name, _REPRESENTATION) * part for name, part in parts.items()),
        start=torch.zeros((), device=sequences.place.device),
    )
    optimizer.zero_grad()
    loss.backward()  # type: ignore[no-untyped-call]
    torch.nn.utils.clip_grad_norm_(agent.parameters(), _CLIP)
    optimizer.step()
    return {name: value.detach() for name, value in ({"loss": loss} | parts).items()}


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
