"""The agent: the networks run over whole sequences, with each mask encoded once."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Self

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional

from adatracker_deploy.learning.checkpoint import ADATRACKER_MASK
from adatracker_deploy.learning.data.shard import distinct_patches, unpack_masks
from adatracker_deploy.learning.mask_statistics import mask_statistics
from adatracker_deploy.learning.networks import (
    AdaTrackerConfig,
    ContextEncoder,
    ContextHeads,
    ContextPolicy,
    DynamicsHead,
    PooledFront,
)
from adatracker_deploy.policy.drawing import colour_table

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from adatracker_deploy.learning.data.dataset import Batch, Dataset

_COLOURS = torch.from_numpy(
    (colour_table(ADATRACKER_MASK.palette, seed=0) * ADATRACKER_MASK.scale).astype(np.float32)
)
"""(4, C), by class: the same table as at deployment."""


def drawn(classes: NDArray[np.uint8] | Tensor) -> Tensor:
    """Return class masks (..., S, S) as networks are shown them: (..., C, S, S), in memory channels last."""
    table = _COLOURS.to(classes.device) if isinstance(classes, Tensor) else _COLOURS
    return functional.embedding(torch.as_tensor(classes).int(), table).movedim(-1, -3)


_CHUNK = 2000
"""Masks that are drawn at a time: 100 MB."""


def statistics_of(packed: NDArray[np.uint8]) -> NDArray[np.float16]:
    """Return the `mask_statistics` (T, F) of packed masks (T, P)."""
    parts = np.array_split(packed, range(_CHUNK, len(packed), _CHUNK))
    return np.concatenate([mask_statistics(drawn(unpack_masks(part))).half().numpy() for part in parts])


CONTEXT_EVERY = 4
"""Steps for which training keeps a context; each costs K steps of the encoder's LSTM. At deployment there is
a new one every tick: it changes little in between, as the consistency task asks."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Sequences:
    """A `Batch` as tensors; K steps of past before L steps."""

    kinds: Tensor
    """(U, C, 4, 4): the different patches of its masks, drawn."""
    place: Tensor
    """(B, K + L, P), int64: which of them each patch of a mask is, by rows."""
    statistics: Tensor
    """(B, K + L, F), `mask_statistics`; no columns where convolutions look, else `place` has none."""
    actions: Tensor
    """(B, K + L, A)."""
    experts: Tensor
    """(B, L, A)."""
    rewards: Tensor
    """(B, L)."""
    done: Tensor
    """(B, L), 0 or 1."""
    valid: Tensor
    """(B, L), 0 or 1."""
    start: Tensor
    """(B,), 0 or 1."""
    height_m: Tensor
    """(B,)."""
    log_limits: Tensor
    """(B, L, 3)."""
    lag_s: Tensor
    """(B, L)."""
    delay_s: Tensor
    """(B, L)."""
    states: Tensor
    """(B, L, S), true; for critics alone."""
    beliefs: Tensor
    """(B, L, `belief.SIZE`); no columns where no policy is told."""
    inputs: Tensor
    """(B, L, U), what the policy's memory reads; no columns unless the data have them."""

    @classmethod
    def of(cls, batch: Batch) -> Self:
        """Return a batch on the CPU."""
        plain = {
            name: torch.from_numpy(np.asarray(getattr(batch, name), np.float32))
            for name in cls.__dataclass_fields__
            if name not in ("kinds", "place")
        }
        if batch.statistics.shape[-1] or batch.inputs.shape[-1]:
            kinds, place = np.zeros((0, 4, 4), np.uint8), np.zeros((*batch.packed.shape[:2], 0), np.int64)
        else:
            kinds, place = distinct_patches(batch.packed)
        return cls(kinds=drawn(kinds), place=torch.from_numpy(place), **plain)

    def to(self, device: torch.device) -> Self:
        """Return the same on a device."""
        moved = {name: getattr(self, name).to(device) for name in self.__dataclass_fields__}
        return type(self)(**moved)

    responses: Tensor
    """(B, L, `response.SIZE`), likewise."""


@dataclass(frozen=True, slots=True)
class Recalled:
    """The networks' outputs for sequences."""

    x: Tensor
    """(B, L, H), the policy's recurrent feature."""
    z: Tensor | None
    """(B, L, Z), the encoder's contexts."""


class Agent(nn.Module):
    """Encoder, policy and the heads that only training needs; both look through one backbone.

    One backbone for both halves the work of an update; a bundle's graphs carry a copy each.
    """

    def __init__(self, config: AdaTrackerConfig) -> None:
        super().__init__()
        self.config = config
        self.policy = ContextPolicy(config)
        self.encoder: ContextEncoder | None = None
        self.heads: ContextHeads | None = None
        self.dynamics: DynamicsHead | None = None
        if config.context:
            self.encoder = ContextEncoder(config)
            self.encoder.backbone = self.policy.backbone
            self.heads, self.dynamics = ContextHeads(config), DynamicsHead(config)
        self.to(memory_format=torch.channels_last)  # type: ignore[call-overload]

    def recall(self, sequences: Sequences, context_every: int = CONTEXT_EVERY) -> Recalled:
        """Run over sequences; the policy's memory begins empty at their first step.

        Args:
            sequences: on the networks' device.
            context_every: steps for which a context is kept.
        """
        inputs, z = self.perceive(sequences, context_every)
        x, _ = self.policy.remember(inputs)
        return Recalled(x, z)

    def perceive(self, sequences: Sequences, context_every: int) -> tuple[Tensor, Tensor | None]:
        """Return what the policy's memory reads (B, L, U), and z; arguments as for `recall`."""
        front = self.policy.backbone
        if isinstance(front, PooledFront):
            features = front.of_statistics(sequences.statistics)
        else:
            features = front.of_patches(sequences.kinds, sequences.place)
        past = features.shape[1] - sequences.valid.shape[1]
        z = None
        if self.encoder is not None:
            z = self._contexts(self.encoder, features, sequences.actions, context_every)
        last_actions = sequences.actions[:, past - 1 : -1] if self.config.last_action else None
        beliefs = sequences.beliefs if self.config.belief else None
        told = torch.cat((z, sequences.responses), dim=-1) if z is not None and self.config.response else z
        return self.policy.inputs(features[:, past:], told, last_actions, beliefs), z

    def _contexts(self, encoder: ContextEncoder, features: Tensor, actions: Tensor, every: int) -> Tensor:
        """Return z (B, L, Z), made from the K pairs before every `every`-th step."""
        pairs = torch.cat((features, actions), dim=-1)[:, :-1]
        windows = pairs.unfold(1, self.config.history, every).transpose(2, 3)
        z = encoder.summarise(windows.flatten(0, 1)).reshape(*windows.shape[:2], -1)
        return z.repeat_interleave(every, dim=1)[:, : features.shape[1] - self.config.history]


_TOGETHER = 16
"""Episodes that are looked through at a time."""


@torch.no_grad()
def inputs_of(agent: Agent, data: Dataset) -> NDArray[np.float16]:
    """Return what an agent's policy reads at each step of the data (T, U), with a context for each.

    For methods that leave front and encoder as they are.
    """
    device = next(agent.parameters()).device
    lengths = np.array([header.steps for header in data.headers])
    parts = []
    for together in np.array_split(np.arange(len(lengths)), range(_TOGETHER, len(lengths), _TOGETHER)):
        length, past = int(lengths[together].max()), max(agent.config.history, 1)
        batch = data.take(together, np.zeros_like(together), length, past)
        inputs, _ = agent.perceive(Sequences.of(batch).to(device), context_every=1)
        rows = inputs.half().cpu().numpy()
        parts += [row[: lengths[index]] for index, row in zip(together, rows, strict=True)]
    return np.concatenate(parts)
