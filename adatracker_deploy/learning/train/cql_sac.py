"""CQL-SAC, the paper's offline reinforcement learning: conservative twin critics and an entropic actor.

The paper gives two formulas and leaves the rest open. What is chosen here, and where it is from:

* The first term of ``L_D`` is printed with ``-E_{a ~ pi_phi}[Q]``, the learned policy. The text says that it
  brings Q near the data's log-density, and in the method it cites (Kumar et al., "Conservative Q-Learning for
  Offline Reinforcement Learning", NeurIPS 2020, equation 4) and in the public code of Offline EVT the
  expectation is over the data's actions. So it is here.
* ``log sum_a exp Q`` is the importance-sampled estimate of that paper's appendix F: uniform actions, actions
  of the policy at the state and at the next one, ten of each; weight 1 and no Lagrange multiplier, as in the
  public code.
* Discount .99, soft updates of the target critics by 0.005, a learned entropy weight alpha with target
  entropy ``-dim(A)``, gradients clipped at 1: the public code. Learning rates 3e-4, and 3e-5 for the actor:
  Kumar et al.'s; the public code has 3e-5 for all, and its published weights had 42,000 updates.
* "We jointly optimize the context encoder and the policy": the critics' losses and ``L_rep`` train backbone,
  encoder and the policy's LSTM; the actor's loss trains the actor alone, on a feature that it does not move,
  as in the public code.
* An episode ends where the target counts as lost; a horizon ends none, and its last step has no next state.
"""

from __future__ import annotations

import copy
import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional

from adatracker_deploy.learning.losses import mean_where
from adatracker_deploy.learning.networks import Critic
from adatracker_deploy.learning.train.agent import Agent, Sequences
from adatracker_deploy.learning.train.method import Learner, counted, representation_losses
from adatracker_deploy.learning.train.settings import TrainSettings

_DISCOUNT = 0.99
_SOFT_UPDATE = 0.005
_SAMPLES = 10
_RATE, _ACTOR_RATE = 3e-4, 3e-5
_CLIP = 1.0


class CqlSac(Learner):
    """Implements `Learner`.

    Attributes:
        critics: the twins.
    """

    def __init__(self, agent: Agent, settings: TrainSettings) -> None:
        self.agent = agent
        self._settings = settings
        config = agent.config
        device = next(agent.parameters()).device
        self.critics = nn.ModuleList(Critic(config.hidden, config.actions) for _ in range(2)).to(device)
        self._targets = copy.deepcopy(self.critics).requires_grad_(False)
        self._log_alpha = torch.zeros((), device=device, requires_grad=True)
        actor = list(agent.policy.actor.parameters())
        rest = [weight for weight in agent.parameters() if all(weight is not own for own in actor)]
        self._perception = [*rest, *self.critics.parameters()]
        rate = settings.rate or _RATE
        actor_rate = rate * _ACTOR_RATE / _RATE
        self._critic_optimizer = torch.optim.Adam(self._perception, lr=rate)
        self._actor_optimizer = torch.optim.Adam(actor, lr=actor_rate)
        self._alpha_optimizer = torch.optim.Adam([self._log_alpha], lr=actor_rate)

    def update(self, sequences: Sequences, number: int) -> dict[str, Tensor]:
        """Take one step each: critics with all that sees, actor, entropy weight, target critics."""
        torch.manual_seed(int(np.random.SeedSequence([self._settings.seed, number]).generate_state(1)[0]))
        with torch.autocast(sequences.place.device.type, torch.bfloat16, enabled=self._settings.bfloat16):
            recalled = self.agent.recall(sequences)
            steps = Transitions.of(recalled.x.float(), sequences)
            bellman, conservative = self._critic_losses(steps)
            parts = representation_losses(self.agent, recalled.z, sequences, self._settings)
        loss = sum(parts.values(), start=bellman + conservative)
        self._critic_optimizer.zero_grad()
        loss.backward()  # type: ignore[no-untyped-call]
        nn.utils.clip_grad_norm_(self._perception, _CLIP)
        self._critic_optimizer.step()
        actor, entropy = self._improve_actor(steps)
        self._follow()
        told = {"bellman": bellman, "conservative": conservative, "actor": actor, "entropy": entropy}
        scalars = {"loss": loss, **told, "alpha": self._log_alpha.exp(), **parts}
        return {name: value.detach() for name, value in scalars.items()}

    def _critic_losses(self, steps: Transitions) -> tuple[Tensor, Tensor]:
        """Return the two terms of ``L_D``, each summed over the two critics."""
        actor, alpha = self.agent.policy.actor, self._log_alpha.exp().detach()
        with torch.no_grad():
            after, log_probability = sample_action(actor, steps.x_next)
            worth = torch.minimum(*(target(steps.x_next, after) for target in self._targets))
            returns = steps.rewards + _DISCOUNT * (1 - steps.done) * (worth - alpha * log_probability)
            proposals = _proposals(actor, steps)
        bellman = conservative = torch.zeros((), device=steps.x.device)
        for critic in self.critics:
            value = critic(steps.x, steps.actions)
            bellman = bellman + 0.5 * mean_where((value - returns) ** 2, steps.weight)
            everywhere = log_sum_exp(critic, steps.x, *proposals)
            conservative = conservative + mean_where(everywhere - value, steps.weight)
        return bellman, conservative

    def _improve_actor(self, steps: Transitions) -> tuple[Tensor, Tensor]:
        """Step actor and entropy weight; return ``L_actor`` and the policy's entropy."""
        x = steps.x.detach()
        action, log_probability = sample_action(self.agent.policy.actor, x)
        worth = torch.minimum(*(critic(x, action) for critic in self.critics))
        loss = mean_where(self._log_alpha.exp().detach() * log_probability - worth, steps.weight)
        self._actor_optimizer.zero_grad()
        loss.backward()  # type: ignore[no-untyped-call]
        nn.utils.clip_grad_norm_(self.agent.policy.actor.parameters(), _CLIP)
        self._actor_optimizer.step()
        entropy = -mean_where(log_probability.detach(), steps.weight)
        wanted = -float(self.agent.config.actions)
        self._alpha_optimizer.zero_grad()
        (self._log_alpha.exp() * (entropy - wanted)).backward()  # type: ignore[no-untyped-call]
        self._alpha_optimizer.step()
        return loss, entropy

    @torch.no_grad()
    def _follow(self) -> None:
        for target, weight in zip(self._targets.parameters(), self.critics.parameters(), strict=True):
            target.lerp_(weight, _SOFT_UPDATE)

    def state_dict(self) -> dict[str, Any]:
        """Return all weights and moments."""
        return {
            "agent": self.agent.state_dict(),
            "critics": self.critics.state_dict(),
            "targets": self._targets.state_dict(),
            "log_alpha": self._log_alpha.detach(),
            "critic_optimizer": self._critic_optimizer.state_dict(),
            "actor_optimizer": self._actor_optimizer.state_dict(),
            "alpha_optimizer": self._alpha_optimizer.state_dict(),
        }

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Take up what `state_dict` returned."""
        self.agent.load_state_dict(state["agent"])
        self.critics.load_state_dict(state["critics"])
        self._targets.load_state_dict(state["targets"])
        with torch.no_grad():
            self._log_alpha.copy_(state["log_alpha"])
        self._critic_optimizer.load_state_dict(state["critic_optimizer"])
        self._actor_optimizer.load_state_dict(state["actor_optimizer"])
        self._alpha_optimizer.load_state_dict(state["alpha_optimizer"])


@dataclass(frozen=True, slots=True, kw_only=True)
class Transitions:
    """Steps with what came after them, each (B, L - 1, ...)."""

    x: Tensor
    x_next: Tensor
    """Detached: what is learned from it is the return, not the feature."""
    actions: Tensor
    """Executed."""
    rewards: Tensor
    done: Tensor
    weight: Tensor
    """1 where the step counts and its next state is known or does not matter."""

    @classmethod
    def of(cls, x: Tensor, sequences: Sequences) -> Transitions:
        """Return the transitions of sequences whose recurrent features are x (B, L, H)."""
        length = x.shape[1]
        done = sequences.done[:, :-1]
        known = torch.maximum(sequences.valid[:, 1:], done)
        return cls(
            x=x[:, :-1],
            x_next=x[:, 1:].detach(),
            actions=sequences.actions[:, -length:-1],
            rewards=sequences.rewards[:, :-1],
            done=done,
            weight=counted(sequences)[:, :-1] * known,
        )


def sample_action(actor: nn.Module, x: Tensor) -> tuple[Tensor, Tensor]:
    """Return an action (..., A) of the policy at x (..., H), and its log-probability (...,).

    The density of tanh(u) is that of u divided by 1 - tanh(u)^2, whose logarithm is written so that it stays
    finite: Haarnoja et al., "Soft Actor-Critic Algorithms and Applications" (2018), appendix C.
    """
    mean, log_std = actor(x)
    noise = torch.randn_like(mean)
    raw = mean + log_std.exp() * noise
    gaussian = -0.5 * noise**2 - log_std - 0.5 * math.log(2 * math.pi)
    squashed = 2.0 * (math.log(2.0) - raw - functional.softplus(-2.0 * raw))
    return torch.tanh(raw), (gaussian - squashed).sum(-1)


def _proposals(actor: nn.Module, steps: Transitions) -> tuple[Tensor, Tensor]:
    """Return actions (N, B, L - 1, A) to estimate the sum over actions with, and their log-densities."""
    count, size = (_SAMPLES, *steps.actions.shape[:-1]), steps.actions.shape[-1]
    anywhere = torch.rand(*count, size, device=steps.x.device) * 2.0 - 1.0
    density = torch.full(count, -size * math.log(2.0), device=steps.x.device)
    here = sample_action(actor, steps.x.expand(*count, -1))
    after = sample_action(actor, steps.x_next.expand(*count, -1))
    return torch.cat((anywhere, here[0], after[0])), torch.cat((density, here[1], after[1]))


def log_sum_exp(critic: nn.Module, x: Tensor, actions: Tensor, log_density: Tensor) -> Tensor:
    """Return the estimate of ``log integral exp Q(x, a) da`` from N proposals.

    Args:
        critic: Q.
        x: (..., H).
        actions: (N, ..., A).
        log_density: (N, ...), of each action under what proposed it.

    Returns:
        (...,).
    """
    values = critic(x.expand(len(actions), *x.shape), actions)
    return torch.logsumexp(values - log_density, dim=0) - math.log(len(actions))
