"""Loss functions of tensors; the methods in `train` sum them.

B sequences of L steps; `weight` (B, L) is 1 where a step counts and 0 where it does not, and every loss is a
mean over the steps that count. Equations are those of the AdaTracker paper unless they are marked as ours.
"""

from __future__ import annotations

import torch
from torch import Tensor
from torch.nn import functional

DYNAMICS_UNITS = (0.5, 0.25, 0.15, 0.1)
"""Units of the logarithms of the forward and yaw limit, and of lag and delay (s): about their standard
deviations in the `deploy` recipe, so that each weighs the same."""

_HUBER = 0.5
"""Huber threshold, with an action's range of 2: a larger error is due to the situation (target out of
sight)."""


def mean_where(values: Tensor, weight: Tensor) -> Tensor:
    """Return the mean of values (B, L) over the steps that count; 0 where none does."""
    return (values * weight).sum() / weight.sum().clamp(min=1.0)


def cloning_loss(mean: Tensor, experts: Tensor, weight: Tensor) -> Tensor:
    """Return how far the deployed action is from the expert's clean one; ours.

    Args:
        mean: (B, L, A), before tanh.
        experts: (B, L, A), in [-1, 1].
        weight: (B, L).
    """
    error = functional.huber_loss(torch.tanh(mean), experts, reduction="none", delta=_HUBER)
    return mean_where(error.sum(-1), weight)


def reward_loss(predicted: Tensor, rewards: Tensor, weight: Tensor) -> Tensor:
    """Return ``L_reward`` of predicted and true rewards, each (B, L)."""
    return mean_where((predicted - rewards) ** 2, weight)


def height_loss(predicted: Tensor, height_m: Tensor, weight: Tensor) -> Tensor:
    """Return ``L_height`` of predicted heights (B, L) and the episodes' heights (B,), m; NaN: unknown."""
    return mean_where(_error(predicted, height_m[:, None]) ** 2, weight)


def dynamics_targets(log_limits: Tensor, lag_s: Tensor, delay_s: Tensor) -> Tensor:
    """Return what the dynamics head predicts, (B, L, 4): forward and yaw limit, lag, delay, in their units.

    Args:
        log_limits: (B, L, 3), natural logarithms of the limits forward, backward (m/s) and yaw (rad/s).
        lag_s: (B, L).
        delay_s: (B, L).
    """
    told = torch.stack((log_limits[..., 0], log_limits[..., 2], lag_s, delay_s), dim=-1)
    return told / torch.tensor(DYNAMICS_UNITS, device=told.device)


def dynamics_loss(predicted: Tensor, targets: Tensor, weight: Tensor) -> Tensor:
    """Return the mean squared error of predictions and targets, each (B, L, 4), NaN: unknown; ours."""
    return mean_where((_error(predicted, targets) ** 2).mean(-1), weight)


def consistency_loss(z: Tensor, start: Tensor, weight: Tensor, first: int) -> Tensor:
    """Return ``L_cons``: 1 - the mean cosine between an episode's first contexts and its average one.

    The average is over the steps at hand: training sees sequences, not whole episodes.

    Args:
        z: (B, L, Z).
        start: (B,), the sequence begins at its episode's start; others have no first contexts.
        weight: (B, L).
        first: K, how many contexts are the first.
    """
    average = (z * weight[..., None]).sum(1) / weight.sum(1).clamp(min=1.0)[:, None]
    near = functional.cosine_similarity(average[:, None], z, dim=-1)
    early = (weight * start[:, None])[:, :first]
    return mean_where(1.0 - near[:, :first], early)


def _error(predicted: Tensor, targets: Tensor) -> Tensor:
    """Return predictions less targets; 0, without a gradient, where a target is not known."""
    difference = predicted - targets.nan_to_num()
    return torch.where(targets.isnan(), torch.zeros_like(difference), difference)
