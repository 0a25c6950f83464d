"""Critics of the state, and the deterministic policy that they improve: TD3 with a term of cloning.

Simulation knows the state that masks only hint at, so what an action is worth can be learned from it, while
the policy that is deployed sees masks alone (asymmetric actor-critic: Pinto et al., "Asymmetric Actor Critic
for Image-Based Robot Learning", 2018). Fujimoto and Gu, "A Minimalist Approach to Offline Reinforcement
Learning" (NeurIPS 2021): TD3 whose actor also imitates the data. A log knows no true state: there critics see
what was measured, boxes and velocities.
"""

from __future__ import annotations

import copy
import itertools
from collections.abc import Callable
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional

from adatracker_deploy.learning.data.dataset import Dataset, Moves
from adatracker_deploy.learning.data.state import COLUMNS

_WIDTH = 128
_DISCOUNT = 0.9
_FOLLOW = 0.02
"""Soft update of the targets. A slower one (0.005) looks ahead fewer steps in 3000 updates than delay and lag
take."""
_SMOOTHING, _MOST_SMOOTHING = 0.1, 0.3
"""Standard deviation and largest size of the noise on the target policy's action."""
_CLONING = 0.1
"""Weight of imitation in the state policy's loss, whose other term has a mean size of 1."""
_RATE, _LAST_SHARE, _DECAY_FROM = 1e-3, 0.05, 0.5
_BATCH = 256
_SAMPLES = 10
_SPREAD_STATES = 4000
_GRID = (-0.9, 0.0, 0.9)
_TARGET = "target_ahead_m_s"
LIMITS = ("log_forward", "log_backward", "log_yaw")
"""Columns of a state: the logarithms of a body's limits, m/s and rad/s."""


def commanded(
    actions: Tensor, log_forward: Tensor, log_backward: Tensor, log_yaw: Tensor
) -> tuple[Tensor, Tensor]:
    """Return the speed ahead (...), m/s, and the turn (...), rad/s, that actions (..., 2) ask of bodies.

    As a body is driven (`policy.base.to_twist`, `sim.bodies`): an action backward is a share of the limit
    forward, too, and is clipped to the limit backward.

    Args:
        actions: in [-1, 1], ahead and to the left.
        log_forward: as `LIMITS` names them, (...).
        log_backward: likewise.
        log_yaw: likewise.
    """
    forward, yaw = actions[..., 0], actions[..., 1]
    return (forward * log_forward.exp()).maximum(-log_backward.exp()), yaw * log_yaw.exp()


class TwinCritics(nn.Module):
    """Twin critics Q(s, a) of states.

    Args:
        columns: of a state: the true one's, perhaps with more behind them, or what a log measured
            (`logged.COLUMNS`).
        width: of a critic's two hidden layers.

    Attributes:
        spread: by how much Q differs over actions, on average over the data; the unit of an advantage.
    """

    mean: Tensor
    std: Tensor
    spread: Tensor

    def __init__(self, columns: tuple[str, ...] = COLUMNS, width: int = _WIDTH) -> None:
        super().__init__()
        states = len(columns)
        self._columns = columns
        moved = 3 if _TARGET in columns else 2
        self.critics = nn.ModuleList(_network(states + 2 + moved, 1, width) for _ in range(2))
        self.register_buffer("mean", torch.zeros(states))
        self.register_buffer("std", torch.ones(states))
        self.register_buffer("spread", torch.zeros(()))

    def values(self, states: Tensor, actions: Tensor) -> Tensor:
        """Return both critics' values (2, ...) of actions (..., 2) in states (..., S)."""
        seen = torch.cat((self._standard(states), actions, self._moved(states, actions)), dim=-1)
        return torch.stack([critic(seen).squeeze(-1) for critic in self.critics])

    @torch.no_grad()
    def measure_spread(self, worth: Callable[[Tensor], Tensor]) -> None:
        """Set `spread`.

        Args:
            worth: what an action, (2,), is worth in each of the states that count.
        """
        grid = torch.tensor(list(itertools.product(_GRID, _GRID)), device=self.mean.device)
        values = torch.stack([worth(action) for action in grid])
        self.spread.copy_(values.std(0).mean().clamp(min=1e-6))

    def _standard(self, states: Tensor) -> Tensor:
        standard: Tensor = (states - self.mean) / self.std
        return standard

    def _moved(self, states: Tensor, actions: Tensor) -> Tensor:
        """Return what actions mean in this body, halved: speed, turn and, if known, speed to the target."""
        speed, turn = commanded(actions, *(self._of(states, column) for column in LIMITS))
        told = (speed, turn, speed - self._of(states, _TARGET)) if _TARGET in self._columns else (speed, turn)
        return torch.stack(told, dim=-1) / 2

    def _of(self, states: Tensor, column: str) -> Tensor:
        return states[..., self._columns.index(column)]


class StateCritics(TwinCritics):
    """Twin critics and a policy pi(s) of the same states; arguments as for `TwinCritics`."""

    def __init__(self, columns: tuple[str, ...] = COLUMNS) -> None:
        super().__init__(columns)
        self.policy = _network(len(columns), 2, _WIDTH)

    @property
    def fitted(self) -> bool:
        """Whether `fit` has run to its end."""
        return bool(self.spread > 0)

    def act(self, states: Tensor) -> Tensor:
        """Return the state policy's actions (..., 2) in [-1, 1]."""
        return torch.tanh(self.policy(self._standard(states)))

    @torch.no_grad()
    def advantage(self, states: Tensor, actions: Tensor) -> Tensor:
        """Return by how much actions are better than the state policy's (...,), in units of `spread`."""
        better = self.values(states, actions).mean(0) - self.values(states, self.act(states)).mean(0)
        return better / self.spread

    def fit(self, data: Dataset, *, updates: int, conservative: float, seed: int) -> dict[str, float]:
        """Learn from logged steps: executed actions and rewards alone; return the last losses.

        Args:
            data: what is learned from.
            updates: how many.
            conservative: weight of Kumar et al.'s term (2020, equation 4), over uniform actions.
            seed: fixes every draw.
        """
        rng = np.random.default_rng([seed, 0xC217])
        torch.manual_seed(int(rng.integers(1 << 31)))
        self.mean.copy_(torch.from_numpy(data.steps.states.mean(0)))
        self.std.copy_(torch.from_numpy(data.steps.states.std(0)).clamp(min=1e-3))
        target = copy.deepcopy(self).requires_grad_(False)
        critics = torch.optim.Adam(self.critics.parameters(), lr=_RATE)
        policy = torch.optim.Adam(self.policy.parameters(), lr=_RATE)
        critic_loss = policy_loss = torch.zeros(())
        for update in range(updates):
            for optimizer in (critics, policy):
                optimizer.param_groups[0]["lr"] = _RATE * falling(update / updates)
            moves = _Tensors(data.moves(rng, _BATCH), self.mean.device)
            critic_loss = self._critic_loss(moves, target, conservative)
            critics.zero_grad()
            critic_loss.backward()  # type: ignore[no-untyped-call]
            critics.step()
            policy_loss = self._policy_loss(moves)
            policy.zero_grad()
            policy_loss.backward()  # type: ignore[no-untyped-call]
            policy.step()
            with torch.no_grad():
                for slow, fast in zip(target.parameters(), self.parameters(), strict=True):
                    slow.lerp_(fast, _FOLLOW)
        states = _Tensors(data.moves(rng, _SPREAD_STATES), self.mean.device).states
        self.measure_spread(lambda action: self.values(states, action.expand(len(states), 2)).mean(0))
        return {"critics": float(critic_loss.detach()), "state_policy": float(policy_loss.detach())}

    def _critic_loss(self, moves: _Tensors, target: StateCritics, conservative: float) -> Tensor:
        with torch.no_grad():
            noise = (torch.randn_like(moves.actions) * _SMOOTHING).clamp(-_MOST_SMOOTHING, _MOST_SMOOTHING)
            after = (target.act(moves.nexts) + noise).clamp(-1.0, 1.0)
            worth = target.values(moves.nexts, after).amin(0)
            returns = moves.rewards * (1 - _DISCOUNT) + _DISCOUNT * (1 - moves.done) * worth
        values = self.values(moves.states, moves.actions)
        loss = functional.mse_loss(values, returns.expand_as(values))
        if conservative:
            anywhere = torch.rand(_SAMPLES, *moves.actions.shape, device=values.device) * 2 - 1
            everywhere = self.values(moves.states.expand(_SAMPLES, -1, -1), anywhere)
            loss = loss + conservative * (everywhere.logsumexp(1) - np.log(_SAMPLES) - values).mean()
        return loss

    def _policy_loss(self, moves: _Tensors) -> Tensor:
        actions = self.act(moves.states)
        worth = self.values(moves.states, actions)[0]
        cloning = ((actions - moves.actions) ** 2).sum(-1).mean()
        return -worth.mean() / worth.detach().abs().mean().clamp(min=1e-6) + _CLONING * cloning


class _Tensors:
    """`Moves` as float tensors."""

    def __init__(self, moves: Moves, device: torch.device) -> None:
        def on_device(values: Any) -> Tensor:
            return torch.from_numpy(np.asarray(values, np.float32)).to(device)

        self.states, self.actions = on_device(moves.states), on_device(moves.actions)
        self.rewards, self.done = on_device(moves.rewards), on_device(moves.done)
        self.nexts = on_device(moves.nexts)


def _network(inputs: int, outputs: int, width: int) -> nn.Sequential:
    return nn.Sequential(
        *(nn.Linear(inputs, width), nn.LayerNorm(width), nn.ReLU()),
        *(nn.Linear(width, width), nn.LayerNorm(width), nn.ReLU()),
        nn.Linear(width, outputs),
    )


def falling(done: float) -> float:
    """Return the share of the learning rate when a share `done` lies behind: 1, then falling to 5 %."""
    fallen = max(0.0, (done - _DECAY_FROM) / (1 - _DECAY_FROM))
    return 1 - (1 - _LAST_SHARE) * fallen
