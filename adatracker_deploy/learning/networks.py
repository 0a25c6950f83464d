"""The networks: AdaTracker's context encoder and policy, and the published Offline-EVT policy.

AdaTracker is as its paper describes it: ``z_t = f_psi(H_t)`` over the past K mask-action pairs, and a
recurrent policy on ``concat(CNN(m_t), z_t)``. What the paper leaves open is said where it is chosen, and what
is not the paper's is marked as ours. Masks are float32 (..., C, S, S), drawn and scaled as the bundle's
manifest says; actions are float32 in [-1, 1]; B is the batch, T and K are lengths in time.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, Literal

import torch
from torch import Tensor, nn
from torch.nn import functional

from adatracker_deploy.config.schema import Range
from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.learning.drivers import LstmState, actor_of, memory_of
from adatracker_deploy.learning.mask_statistics import PER_CHANNEL, STRIPS, mask_statistics
from adatracker_deploy.policy import belief, response


@dataclass(frozen=True, slots=True, kw_only=True)
class AdaTrackerConfig:
    """The sizes of AdaTracker's networks; the paper gives none, so each default has its reason.

    A mask has three channels, one for the target, other people and obstacles each: drawn as grey levels, the
    resized edge of one class passes through the value of another.
    """

    channels: Literal[1, 3] = 3
    size: Annotated[int, Range(16, 256)] = 64
    """Side of the square mask, pixels; 64 as in the published Offline-EVT policy."""
    actions: Annotated[int, Range(1, 4)] = 2
    history: Annotated[int, Range(0, 256)] = 16
    """K: 1.6 s at 10 Hz, several times the lag of a robot's base (0.1 to 0.4 s); 0 without an encoder."""
    front: Literal["cnn", "pooled"] = "cnn"
    """What looks at a mask: the paper's convolutions (`Backbone`), or fixed statistics and two layers, ours
    (`PooledFront`)."""
    features: Annotated[int, Range(1, 4096)] = 96
    """Number of features of one mask, from its front."""
    context: Annotated[int, Range(0, 1024)] = 16
    """Size of z: a body is a handful of numbers (height, pitch, field of view, limits, lag, delay); 0 without
    an encoder."""
    encoder_hidden: Annotated[int, Range(1, 4096)] = 64
    hidden: Annotated[int, Range(1, 4096)] = 128
    """H of the policy's LSTM. The published Offline-EVT policy has 64 and one body; here, what is remembered
    of the target comes with what was commanded to a body that obeys late."""
    actor: Annotated[int, Range(1, 4096)] = 128
    """Width of the actor's hidden layer."""
    last_action: bool = False
    """The policy's last action is also an input; ours, not the paper's."""
    belief: bool = False
    """The belief across gaps (`policy.belief`) is also an input; ours, not the paper's."""
    response: bool = False
    """The response of the body (`policy.response`) continues z; ours, not the paper's."""
    lstm: bool = True
    """Without, a layer of the same width without memory is in the place of the policy's LSTM."""
    second_driver: bool = False
    """A memory and an actor of their own drive bodies that obey late (`Memories`); ours, not the paper's."""

    def __post_init__(self) -> None:
        if (self.history > 0) is not (self.context > 0):
            raise UsageError(
                f"history {self.history} and context {self.context}: both are 0 (no encoder) or neither is"
            )
        if self.response and not self.context:
            raise UsageError("response: it continues the context, and there is none without an encoder")
        if self.second_driver and not (self.response and self.lstm):
            raise UsageError("second_driver: two LSTMs drive, the response decides; it needs both")
        if self.front == "pooled" and self.size % STRIPS:
            raise UsageError(f"front pooled: a mask of {self.size} pixels is no multiple of {STRIPS}")

    @property
    def inputs(self) -> dict[str, int]:
        """What the policy's memory reads, in this order, and how many numbers each part has."""
        return {
            "features": self.features,
            "context": self.context,
            "response": response.SIZE if self.response else 0,
            "last_action": self.actions if self.last_action else 0,
            "belief": belief.SIZE if self.belief else 0,
        }

    @property
    def told_context(self) -> int:
        """Size of the z that the policy is told: the encoder's and the response."""
        return self.context + self.inputs["response"]

    @property
    def state(self) -> int:
        """Size of h, and of c: what the policy remembers."""
        return 2 * self.hidden if self.second_driver else self.hidden


class Backbone(nn.Module):
    """The convolutions over one mask: (N, C, S, S) -> (N, features).

    The first layer reads 4x4 patches without overlap: a mask is flat almost everywhere, and at full
    resolution one 3x3 layer of this width would cost more than all of these layers together (0.9 million
    multiply-adds at the default sizes).
    """

    def __init__(self, config: AdaTrackerConfig) -> None:
        super().__init__()
        self.patches = nn.Conv2d(config.channels, 16, 4, stride=4)
        self.conv1 = nn.Conv2d(16, 32, 3, stride=2, padding=1)
        self.conv2 = nn.Conv2d(32, 64, 3, stride=2, padding=1)
        side = math.ceil(config.size // 4 / 4)  # the patches' rows and columns, halved twice
        self.project = nn.Linear(64 * side**2, config.features)

    def forward(self, mask: Tensor) -> Tensor:
        """Return the features, non-negative."""
        return self._beyond(functional.relu(self.patches(mask)))

    def of_patches(self, kinds: Tensor, place: Tensor) -> Tensor:
        """Return the same (B, T, features) of masks that are given by their different patches.

        The first layer then looks at each patch once, however often it occurs.

        Args:
            kinds: (U, C, 4, 4).
            place: (B, T, P), int64: which of them each patch of a mask is, by rows.
        """
        first = functional.relu(self.patches(kinds)).flatten(1)
        across = math.isqrt(place.shape[-1])
        # A gather, as its gradient takes half the time of an embedding's.
        x = first.gather(0, place.reshape(-1, 1).expand(-1, first.shape[1]))
        x = x.reshape(-1, across, across, first.shape[1])
        features: Tensor = self._beyond(x.permute(0, 3, 1, 2))
        return features.reshape(*place.shape[:2], -1)

    def _beyond(self, x: Tensor) -> Tensor:
        """Return the features of the first layer's output (N, 16, S / 4, S / 4)."""
        x = functional.relu(self.conv1(x))
        x = functional.relu(self.conv2(x))
        return functional.relu(self.project(x.flatten(1)))

    def sequences(self, masks: Tensor) -> Tensor:
        """Return the features (B, T, features) of masks (B, T, C, S, S)."""
        features: Tensor = self(masks.flatten(0, 1))
        return features.reshape(*masks.shape[:2], -1)


class PooledFront(nn.Module):
    """Statistics of one mask and two layers, in the convolutions' place: (N, C, S, S) -> (N, features)."""

    def __init__(self, config: AdaTrackerConfig) -> None:
        super().__init__()
        self.mix = nn.Linear(config.channels * PER_CHANNEL, config.features)
        self.project = nn.Linear(config.features, config.features)

    def forward(self, mask: Tensor) -> Tensor:
        """Return the features, non-negative."""
        return self.of_statistics(mask_statistics(mask))

    def of_statistics(self, statistics: Tensor) -> Tensor:
        """Return the same (..., features) of masks' `mask_statistics` (..., C x `PER_CHANNEL`)."""
        return functional.relu(self.project(functional.relu(self.mix(statistics))))

    def sequences(self, masks: Tensor) -> Tensor:
        """Return the features (B, T, features) of masks (B, T, C, S, S)."""
        features: Tensor = self(masks.flatten(0, 1))
        return features.reshape(*masks.shape[:2], -1)


Front = Backbone | PooledFront


def front_of(config: AdaTrackerConfig) -> Front:
    """Return what looks at a mask."""
    return PooledFront(config) if config.front == "pooled" else Backbone(config)


class ContextEncoder(nn.Module):
    """``f_psi``: K mask-action pairs -> z, "a convolutional backbone and a single-layer LSTM".

    Open in the paper: where the action enters (beside the mask's features, at each step of the LSTM), the
    LSTM's initial state (zero) and how its last output becomes z (one linear layer, then tanh, so that z
    stays in [-1, 1] on bodies never seen). Each graph of a bundle stands alone, so it has a backbone of its
    own; training may let the policy use the same one.
    """

    def __init__(self, config: AdaTrackerConfig) -> None:
        super().__init__()
        self.config = config
        self.backbone = front_of(config)
        self.lstm = nn.LSTM(config.features + config.actions, config.encoder_hidden, batch_first=True)
        self.to_context = nn.Linear(config.encoder_hidden, config.context)

    def pairs(self, masks: Tensor, actions: Tensor) -> Tensor:
        """Return what the LSTM reads of each pair.

        Args:
            masks: (B, T, C, S, S).
            actions: (B, T, A), taken at those masks.

        Returns:
            (B, T, F), F = features + A.
        """
        return torch.cat((self.backbone.sequences(masks), actions), dim=-1)

    def summarise(self, pairs: Tensor) -> Tensor:
        """Return z, (B, Z), of pairs (B, K, F), oldest first."""
        _, (last, _) = self.lstm(pairs)
        return torch.tanh(self.to_context(last[0]))

    def forward(self, masks: Tensor, actions: Tensor) -> Tensor:
        """Return z, (B, Z) in [-1, 1], of masks (B, K, C, S, S) and actions (B, K, A), oldest pair first."""
        return self.summarise(self.pairs(masks, actions))


class ContextHeads(nn.Module):
    """``g_phi``: z -> the step's reward and the episode's camera height in m; for training only."""

    def __init__(self, config: AdaTrackerConfig) -> None:
        super().__init__()
        self.mlp = nn.Sequential(nn.Linear(config.context, 64), nn.ReLU(), nn.Linear(64, 2))

    def forward(self, z: Tensor) -> tuple[Tensor, Tensor]:
        """Return (reward, height in m), each (B,), of z (B, Z)."""
        reward, height = self.mlp(z).unbind(-1)
        return reward, height


class DynamicsHead(nn.Module):
    """z -> how the body moves; for training only.

    Ours: the paper trusts the reward's prediction to tie z to the dynamics.
    """

    def __init__(self, config: AdaTrackerConfig) -> None:
        super().__init__()
        self.mlp = nn.Sequential(nn.Linear(config.context, 64), nn.ReLU(), nn.Linear(64, 4))

    def forward(self, z: Tensor) -> Tensor:
        """Return (..., 4) of z (..., Z): what `losses.dynamics_targets` makes of limits, lag and delay."""
        x: Tensor = self.mlp(z)
        return x


class Critic(nn.Module):
    """``Q_theta``: what an action is worth in a state; for training only.

    Shapes as in the published Offline-EVT state dict: (H + A) -> 256 -> 256 -> 1.
    """

    def __init__(self, features: int, actions: int) -> None:
        super().__init__()
        self.mlp = nn.Sequential(
            nn.Linear(features + actions, 256), nn.ReLU(), nn.Linear(256, 256), nn.ReLU(), nn.Linear(256, 1)
        )

    def forward(self, x: Tensor, action: Tensor) -> Tensor:
        """Return (...,), of x (..., H) and action (..., A)."""
        value: Tensor = self.mlp(torch.cat((x, action), dim=-1))
        return value.squeeze(-1)


class ContextPolicy(nn.Module):
    """``u_t = concat(CNN(m_t), z_t); x_t, (h_t, c_t) = LSTM(u_t, (h_{t-1}, c_{t-1}))``, and an actor on x_t.

    At deployment the action is tanh of the mean. Variants leave z out, or put the last action or the belief
    across gaps beside it.
    """

    def __init__(self, config: AdaTrackerConfig) -> None:
        super().__init__()
        self.config = config
        self.backbone = front_of(config)
        self.memory = memory_of(config)
        self.actor = actor_of(config)

    def forward(
        self,
        masks: Tensor,
        z: Tensor | None,
        state: LstmState | None = None,
        last_actions: Tensor | None = None,
        beliefs: Tensor | None = None,
    ) -> tuple[Tensor, Tensor, LstmState | None]:
        """Return (mean, log_std, state) over a sequence.

        Args:
            masks: (B, T, C, S, S).
            z: (B, T, Z), with the response after it where the configuration has it; None without an encoder.
            state: of the step before; zeros if None.
            last_actions: (B, T, A), of the steps before; None where the configuration leaves them out.
            beliefs: (B, T, `belief.SIZE`), likewise.

        Returns:
            mean and log_std, each (B, T, A), before tanh, and the state after the last step.
        """
        x, state = self.recall(self.backbone.sequences(masks), z, state, last_actions, beliefs)
        mean, log_std = self.actor(x)
        return mean, log_std, state

    def recall(
        self,
        features: Tensor,
        z: Tensor | None,
        state: LstmState | None = None,
        last_actions: Tensor | None = None,
        beliefs: Tensor | None = None,
    ) -> tuple[Tensor, LstmState | None]:
        """Return x (B, T, H) and the state after the last step, of the backbone's features (B, T, F)."""
        return self.remember(self.inputs(features, z, last_actions, beliefs), state)

    def inputs(
        self, features: Tensor, z: Tensor | None, last_actions: Tensor | None, beliefs: Tensor | None
    ) -> Tensor:
        """Return u (B, T, U), what the memory reads, in the order of `AdaTrackerConfig.inputs`."""
        return torch.cat([part for part in (features, z, last_actions, beliefs) if part is not None], dim=-1)

    def remember(self, u: Tensor, state: LstmState | None = None) -> tuple[Tensor, LstmState | None]:
        """Return x (B, T, H), as the actor reads it, and the state after the last step, of `inputs`."""
        if isinstance(self.memory, nn.Linear):
            return functional.relu(self.memory(u)), state
        x, state = self.memory(u, state)
        return x, state


class _CnnSimple(nn.Module):
    """Four times convolution, 2x2 max-pool, ReLU: (N, 3, 64, 64) -> (N, 576)."""

    def __init__(self) -> None:
        super().__init__()
        self.conv1 = nn.Conv2d(3, 32, 5, padding=2)
        self.conv2 = nn.Conv2d(32, 32, 5, padding=1)
        self.conv3 = nn.Conv2d(32, 64, 4, padding=1)
        self.conv4 = nn.Conv2d(64, 64, 3, padding=1)

    def forward(self, x: Tensor) -> Tensor:
        for conv in (self.conv1, self.conv2, self.conv3, self.conv4):
            x = functional.relu(functional.max_pool2d(conv(x), 2))
        return x.flatten(1)


class _CnnLstm(nn.Module):
    def __init__(self) -> None:
        super().__init__()
        self.CNN_Simple = _CnnSimple()
        self.lstm = nn.LSTM(576, 64, batch_first=True)


class _EvtActor(nn.Module):
    def __init__(self) -> None:
        super().__init__()
        self.fc1 = nn.Linear(64, 256)
        self.fc2 = nn.Linear(256, 256)
        self.mu = nn.Linear(256, 2)
        self.log_std_linear = nn.Linear(256, 2)


class OfflineEvtPolicy(nn.Module):
    """The published policy of Offline EVT (Zhong et al., ECCV 2024).

    Its modules carry the names of the published state dict; the critics in there are not needed to act. The
    input is drawn 0 to 255 and not normalised; the action is (yaw, clockwise positive, and forward).
    """

    CHANNELS, SIZE, HIDDEN, ACTIONS = 3, 64, 64, 2

    def __init__(self) -> None:
        super().__init__()
        self.CNN_LSTM = _CnnLstm()
        self.actor_local = _EvtActor()

    def forward(self, masks: Tensor, state: LstmState | None = None) -> tuple[Tensor, LstmState]:
        """Return (mean, state): mean (B, T, 2) before tanh, of masks (B, T, 3, 64, 64)."""
        features = self.CNN_LSTM.CNN_Simple(masks.flatten(0, 1)).unflatten(0, masks.shape[:2])
        x, state = self.CNN_LSTM.lstm(features, state)
        x = functional.relu(self.actor_local.fc1(x))
        x = functional.relu(self.actor_local.fc2(x))
        return self.actor_local.mu(x), state
