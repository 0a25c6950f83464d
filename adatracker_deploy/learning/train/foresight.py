"""Where an action leads: by the body's own dynamics, and by the way that the target then went.

The reward has its ridge at bearing zero and 2.5 m, and an action moves a body towards it by little in a step,
less still where it obeys late. A network of the state and the action smooths that away. But how a kinematic
body obeys is known, and a log says how the target went on. So where an action leads can be computed, and a
critic be told: exactly, but for obstacles and for a body that changes within these steps. A drone, which
flies by its own dynamics, is taken for a kinematic body of its nominal lag and delay.

That a critic knows what is to come does not teach the policy to: it cannot see it, and over all that may
come, the gradient is that of the mean (Mao et al., "Variance Reduction for Reinforcement Learning in
Input-Driven Environments", ICLR 2019).
"""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor
from torch.nn import functional

from adatracker_deploy.core.task import DESIRED_DISTANCE_M
from adatracker_deploy.learning.data.state import COLUMNS
from adatracker_deploy.learning.episode_spec import RATE_HZ
from adatracker_deploy.learning.train.critics import LIMITS, commanded

_DT_S = 1.0 / RATE_HZ
_MOST_DELAY = 6
"""Steps. A body with more is taken to have so much."""
_HELD = (1, 2, 4)
"""Steps for which an action that has begun to work is held, and after each of which a critic is told."""
_HORIZON = _MOST_DELAY + max(_HELD)
_LEAST_LAG_S = 1e-3
_BEARING_RAD, _DISTANCE_M = 0.5, 1.0
"""Units of what is told."""
_PLACE = ("bearing", "bearing_size", "too_far", "distance_off")
FORESEEN = tuple(f"{what}_after_{steps}" for steps in _HELD for what in _PLACE)
"""The numbers that a critic is told of an action, each about -1 to 1."""


class _Body(NamedTuple):
    """Bodies in their own frames of now; every field (B, L), m, rad and s."""

    x: Tensor
    y: Tensor
    yaw: Tensor
    forward: Tensor
    turn: Tensor

    def driven(self, forward: Tensor, turn: Tensor, share: Tensor) -> _Body:
        """Return them a step later, as `sim.bodies.KinematicBody` moves.

        Args:
            forward: commanded, m/s.
            turn: commanded, rad/s.
            share: of a difference in speed that a step closes (`sim.bodies.lag_share`).
        """
        forward = self.forward + share * (forward - self.forward)
        turn = self.turn + share * (turn - self.turn)
        along = self.yaw + turn * _DT_S / 2
        return _Body(
            self.x + forward * _DT_S * along.cos(),
            self.y + forward * _DT_S * along.sin(),
            self.yaw + turn * _DT_S,
            forward,
            turn,
        )

    def sees(self, x: Tensor, y: Tensor) -> Tensor:
        """Return `_PLACE` (B, L, 4) of targets."""
        ahead, left = _turned(x - self.x, y - self.y, -self.yaw)
        bearing = torch.atan2(left, ahead) / _BEARING_RAD
        # A target at the same place would have no gradient.
        off = ((ahead**2 + left**2 + 1e-4).sqrt() - DESIRED_DISTANCE_M) / _DISTANCE_M
        return torch.stack((bearing, bearing.abs(), off, off.abs()), dim=-1)


class Foresight:
    """What follows from actions in the states of logged sequences.

    Args:
        states: (B, L, S), true, as `state.COLUMNS` names them.
        actions: (B, P + L, A), executed, of P steps of past and of the sequence.
        valid: (B, L), 0 or 1; after a sequence's last valid step its target goes straight on.
    """

    def __init__(self, states: Tensor, actions: Tensor, valid: Tensor) -> None:
        at = dict(zip(COLUMNS, states.unbind(-1), strict=True))
        length = states.shape[1]
        lag_s = at["lag_s"].clamp(min=_LEAST_LAG_S)
        self._share = 1.0 - torch.exp(-_DT_S / lag_s)
        self._delay = (at["delay_s"] / _DT_S).round().long().clamp(0, _MOST_DELAY)
        self._limits = [at[name] for name in LIMITS]
        origin = torch.zeros_like(lag_s)
        self._body = _Body(origin, origin, origin, at["forward_m_s"], at["yaw_rate_rad_s"])
        past = functional.pad(actions, (0, 0, _MOST_DELAY, 0))[:, -(length + _MOST_DELAY) : -1]
        self._pending = past.unfold(1, _MOST_DELAY, 1).transpose(2, 3)
        """(B, L, `_MOST_DELAY`, A): the actions before each step, the newest last."""
        velocity = at["target_ahead_m_s"], at["target_left_m_s"]
        way = _way(at["yaw_rate_rad_s"], velocity, valid)
        self._targets = [(at["ahead_m"] + x, at["left_m"] + y) for x, y in way]

    def of(self, actions: Tensor) -> Tensor:
        """Return `FORESEEN` (B, L, len) of actions (B, L, A), each given at its own step alone.

        What was given before is obeyed first, as late as the body is; then the action, which is held.
        """
        body, places = self._body, []
        for step, target in enumerate(self._targets):
            waits = self._delay - step  # of the actions before it
            index = (_MOST_DELAY - waits).clamp(max=_MOST_DELAY - 1)[..., None, None]
            before = self._pending.gather(2, index.expand(*index.shape[:3], actions.shape[-1])).squeeze(2)
            obeyed = torch.where(waits[..., None] > 0, before, actions)
            body = body.driven(*commanded(obeyed, *self._limits), self._share)
            places.append(body.sees(*target))
        every = torch.stack(places, dim=2)
        after = self._delay[..., None] + torch.tensor(_HELD, device=every.device) - 1
        return every.gather(2, after[..., None].expand(*after.shape, len(_PLACE))).flatten(2)


def _way(yaw_rate: Tensor, velocity: tuple[Tensor, Tensor], valid: Tensor) -> list[tuple[Tensor, Tensor]]:
    """Return how far a target will have gone in 1, 2, ... `_HORIZON` steps, in the body's frame of now.

    Args:
        yaw_rate: (B, L), of the body in the step before, rad/s.
        velocity: (B, L) each, of the target in the step before, ahead and to the left, m/s.
        valid: see `Foresight`.
    """
    length = valid.shape[1]
    steps = torch.arange(length + _HORIZON, device=valid.device)
    last = (valid * steps[:length]).argmax(1, keepdim=True)
    heading = (yaw_rate * _DT_S).cumsum(1)
    east, north = (
        (part.gather(1, steps.minimum(last)) * _DT_S).cumsum(1) for part in _turned(*velocity, heading)
    )

    def gone(ahead: int) -> tuple[Tensor, Tensor]:
        after = slice(ahead, ahead + length)
        return _turned(east[:, after] - east[:, :length], north[:, after] - north[:, :length], -heading)

    return [gone(ahead) for ahead in range(1, _HORIZON + 1)]


def _turned(x: Tensor, y: Tensor, angle: Tensor) -> tuple[Tensor, Tensor]:
    """Return vectors, turned counter-clockwise by angles in rad."""
    cos, sin = angle.cos(), angle.sin()
    return x * cos - y * sin, x * sin + y * cos
