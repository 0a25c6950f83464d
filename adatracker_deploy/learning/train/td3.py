"""TD3 through a policy's memory: a policy improved by its own visits and their rewards, without labels.

A clone does what its teacher would do in a situation that the teacher knows better than the masks tell. Here
nobody is imitated. Twin critics know the true state, what the policy is told and where an action leads
(`foresight`), and learn what its actions are worth where it really gets to; the policy, which sees masks,
follows their gradient through its memory. So it learns what is best on average over all that its masks leave
open.

Fujimoto, van Hoof and Meger, "Addressing Function Approximation Error in Actor-Critic Methods" (ICML 2018);
Heess et al., "Memory-based control with recurrent neural networks" (2015); critics that know more than the
actor: Pinto et al., "Asymmetric Actor Critic for Image-Based Robot Learning" (2018). Front and encoder stay
as they are, so what the memory reads is computed once for each step. Not the paper's.
"""

from __future__ import annotations

import copy
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional

from adatracker_deploy.core.task import MAX_BEARING_RAD, MAX_DISTANCE_M
from adatracker_deploy.learning.data.state import COLUMNS
from adatracker_deploy.learning.data.visit import Company
from adatracker_deploy.learning.losses import mean_where
from adatracker_deploy.learning.train.agent import Agent, Sequences
from adatracker_deploy.learning.train.critics import TwinCritics, falling
from adatracker_deploy.learning.train.foresight import FORESEEN, Foresight
from adatracker_deploy.learning.train.method import Learner, Say, counted
from adatracker_deploy.learning.train.settings import TrainSettings

if TYPE_CHECKING:
    from adatracker_deploy.learning.data.dataset import Dataset
    from adatracker_deploy.learning.networks import ContextPolicy

_DISCOUNT = 0.95
_WIDTH = 256
_FOLLOW = 0.01
"""Soft update of the target critics."""
_SMOOTHING, _MOST_SMOOTHING = 0.1, 0.3
"""Standard deviation and largest size of the noise on the next action, the source's idea; half its sizes."""
_CRITIC_RATE, _RATE = 1e-3, 6e-5
_CLIP = 1.0
_POLICY_EVERY = 2
"""Updates of the critics for one of the policy, the source's."""
_SPREAD_EVERY = 100
_ANCHOR = 0.5
"""Weight of the distance from the actions of the policy that it began with, in units of the critics' spread,
in a body that turns at `_NOMINAL_YAW_RAD_S` (`_reach`).
A distance and not its square: an action stays where it was unless the critics promise more than this for
moving it. They are smooth where the reward has its ridge (bearing zero, 2.5 m), with the foresight a little
less, so they know a good action worse than the policy does, and a square gives way to that everywhere
(`docs/learning.md`)."""
_ANCHOR_LATE = 0.2
"""The same weight for a driver of bodies that obey late alone, who has more to learn."""
_NEAR = 0.02
"""Distances below are rounded off, so that the gradient has no jump."""
_NOMINAL_YAW_RAD_S = math.radians(120.0)
_LATE_S = 0.4
"""Lag and delay of a body that is held twice as much as one that obeys at once."""
_FORWARD_WEIGHT = 2.0
"""Of the distance along the forward axis, beside what it moves of the reward."""
_LEAST_STD = 0.05
"""Of a state's column, so that what hardly varies in the first data does not blow up later."""


class Td3(Learner):
    """Implements `Learner`.

    Attributes:
        critics: of the true state, of what the policy is told and of where an action leads.
    """

    visits = Company(levels=(0.0, 0.0, 0.1, 0.1, 0.25, 0.5))
    """Half of the perturbations are small or none: the policy's own states count most."""
    reads_inputs = True

    def __init__(self, agent: Agent, settings: TrainSettings) -> None:
        self.agent = agent
        self._settings = settings
        config, device = agent.config, next(agent.parameters()).device
        self._told = sum(config.inputs.values()) - config.features - config.context
        columns = (*COLUMNS, *(f"told_{index}" for index in range(self._told)), *FORESEEN)
        self.critics = TwinCritics(columns, _WIDTH).to(device)
        self._targets = copy.deepcopy(self.critics).requires_grad_(False)
        self._begun = copy.deepcopy(agent.policy).requires_grad_(False)
        self._prepared = False
        self._critic_optimizer = torch.optim.Adam(self.critics.parameters(), lr=_CRITIC_RATE)
        self._acting = [*agent.policy.memory.parameters(), *agent.policy.actor.parameters()]
        self._optimizer = torch.optim.Adam(self._acting, lr=_RATE)

    def prepare(self, data: Dataset, say: Say) -> bool:  # noqa: ARG002 - it is done at once
        """Take note of the policy that it begins with, and of how the states are spread."""
        if self._prepared:
            return False
        self._begun.load_state_dict(self.agent.policy.state_dict())
        count = len(COLUMNS)
        for critics in (self.critics, self._targets):
            critics.mean[:count] = torch.from_numpy(data.steps.states.mean(0))
            critics.std[:count] = torch.from_numpy(data.steps.states.std(0)).clamp(min=_LEAST_STD)
        self._prepared = True
        return True

    def update(self, sequences: Sequences, number: int) -> dict[str, Tensor]:
        """Take one step with the critics and, from the settings' `critic_updates` on, every other one with
        the policy.
        """
        settings = self._settings
        torch.manual_seed(int(np.random.SeedSequence([settings.seed, number]).generate_state(1)[0]))
        done = number / settings.updates
        self._critic_optimizer.param_groups[0]["lr"] = _CRITIC_RATE * falling(done)
        self._optimizer.param_groups[0]["lr"] = (settings.rate or _RATE) * falling(done)
        improves = number >= settings.critic_updates and number % _POLICY_EVERY == 0
        weight = counted(sequences)
        told = sequences.inputs[..., sequences.inputs.shape[-1] - self._told :]
        known = _Known(
            torch.cat((sequences.states, told), dim=-1),
            Foresight(sequences.states, sequences.actions, sequences.valid),
        )
        short = torch.autocast(weight.device.type, torch.bfloat16, enabled=settings.bfloat16)
        with torch.set_grad_enabled(improves), short:
            actions = _acts(self.agent.policy, sequences.inputs).float()
        loss = self._critic_loss(known, actions.detach(), sequences, weight)
        self._critic_optimizer.zero_grad()
        loss.backward()  # type: ignore[no-untyped-call]
        nn.utils.clip_grad_norm_(self.critics.parameters(), _CLIP)
        self._critic_optimizer.step()
        with torch.no_grad():
            for slow, fast in zip(self._targets.parameters(), self.critics.parameters(), strict=True):
                slow.lerp_(fast, _FOLLOW)
        if number % _SPREAD_EVERY == 0 or not self.critics.spread:
            self.critics.measure_spread(lambda action: self._worth(known, action)[sequences.valid > 0])
        losses = {"loss": loss.detach()}
        return losses | self._improve(known, actions, sequences.inputs, weight) if improves else losses

    def _worth(self, known: _Known, actions: Tensor) -> Tensor:
        """Return what the critics think of actions, (B, L, A) or one for all, (A,): (B, L)."""
        actions = actions.expand(*known.states.shape[:-1], -1)
        return self.critics.values(known.of(actions), actions).mean(0)

    def _critic_loss(self, known: _Known, actions: Tensor, sequences: Sequences, weight: Tensor) -> Tensor:
        """Return the twins' mean squared error to one step of reward and the value of what follows."""
        with torch.no_grad():
            noise = (torch.randn_like(actions) * _SMOOTHING).clamp(-_MOST_SMOOTHING, _MOST_SMOOTHING)
            about = (actions + noise).clamp(-1.0, 1.0)
            worth = _next(self._targets.values(known.of(about), about).amin(0))
            returns = sequences.rewards * (1 - _DISCOUNT) + _DISCOUNT * (1 - sequences.done) * worth
        executed = sequences.actions[:, -weight.shape[1] :]
        error = ((self.critics.values(known.of(executed), executed) - returns) ** 2).mean(0)
        follows = functional.pad(sequences.valid[:, 1:], (0, 1))
        return mean_where(error, weight * torch.maximum(follows, sequences.done))

    def _improve(self, known: _Known, actions: Tensor, inputs: Tensor, weight: Tensor) -> dict[str, Tensor]:
        """Take one step with the policy."""
        with torch.no_grad():
            before = _acts(self._begun, inputs)
        self.critics.requires_grad_(False)
        worth = mean_where(self._worth(known, actions), weight)
        self.critics.requires_grad_(True)
        late = self._settings.late
        moved = _reach(known.states, late=late) * ((actions - before) ** 2 + _NEAR**2).sqrt()
        apart = mean_where(moved.sum(-1), weight)
        self._optimizer.zero_grad()
        anchor = _ANCHOR_LATE if late else _ANCHOR
        (anchor * apart - worth / self.critics.spread).backward()  # type: ignore[no-untyped-call]
        nn.utils.clip_grad_norm_(self._acting, _CLIP)
        self._optimizer.step()
        return {"worth": worth.detach(), "apart": apart.detach()}

    def state_dict(self) -> dict[str, Any]:
        """Return weights and Adam's moments."""
        return {
            "agent": self.agent.state_dict(),
            "critics": self.critics.state_dict(),
            "targets": self._targets.state_dict(),
            "begun": self._begun.state_dict(),
            "prepared": self._prepared,
            "critic_optimizer": self._critic_optimizer.state_dict(),
            "optimizer": self._optimizer.state_dict(),
        }

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Take up what `state_dict` returned."""
        self.agent.load_state_dict(state["agent"])
        self.critics.load_state_dict(state["critics"])
        self._targets.load_state_dict(state["targets"])
        self._begun.load_state_dict(state["begun"])
        self._prepared = state["prepared"]
        self._critic_optimizer.load_state_dict(state["critic_optimizer"])
        self._optimizer.load_state_dict(state["optimizer"])


@dataclass(frozen=True, slots=True)
class _Known:
    """What critics know of a sequence's steps."""

    states: Tensor
    """(B, L, S): true, and what the policy is told."""
    foresight: Foresight

    def of(self, actions: Tensor) -> Tensor:
        """Return all that they know with actions (B, L, A) in view."""
        return torch.cat((self.states, self.foresight.of(actions)), dim=-1)


def _reach(states: Tensor, *, late: bool = False) -> Tensor:
    """Return what the anchor asks of a difference of 1 along each axis of an action (B, L, 2).

    It is what that moves of the next reward, in units of turning at `_NOMINAL_YAW_RAD_S`: an axis that moves
    little of it gains little, too. Bodies that obey late are held more, for what the critics promise lies
    further ahead, unless they are what is learned (`late`). Where the target is not visible it is 1: there
    the critics know what the policy cannot. Without these two, targets are lost in `hard` that were kept
    (`docs/learning.md`).
    """
    at = dict(zip(COLUMNS, states.unbind(-1), strict=False))
    forward, yaw = at["log_forward"].exp(), at["log_yaw"].exp()
    of_turning = _NOMINAL_YAW_RAD_S / MAX_BEARING_RAD
    reach = torch.stack((_FORWARD_WEIGHT * forward / MAX_DISTANCE_M, yaw / MAX_BEARING_RAD), -1) / of_turning
    if not late:
        reach = reach * (1.0 + ((at["lag_s"] + at["delay_s"]) / _LATE_S) ** 2)[..., None]
    return torch.where(at["visible"][..., None] > 0, reach, torch.ones_like(reach))


def _acts(policy: ContextPolicy, inputs: Tensor) -> Tensor:
    """Return the actions (B, L, A) of a memory that begins empty."""
    x, _ = policy.remember(inputs)
    mean, _ = policy.actor(x)
    return torch.tanh(mean)


def _next(values: Tensor) -> Tensor:
    """Return values (B, L, ...) one step on; the last, of which there is no next, stays."""
    return torch.cat((values[:, 1:], values[:, -1:]), dim=1)
