"""CQL-SAC's parts against closed forms, and critics that learn what a known problem is worth."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import nn

from adatracker_deploy.learning.data.state import COLUMNS
from adatracker_deploy.learning.drivers import Actor
from adatracker_deploy.learning.networks import AdaTrackerConfig
from adatracker_deploy.learning.train.agent import Agent, Sequences
from adatracker_deploy.learning.train.cql_sac import CqlSac, Transitions, log_sum_exp, sample_action
from adatracker_deploy.learning.train.settings import BURN_IN, TrainSettings

H, A = 6, 2


def an_actor(seed=0):
    torch.manual_seed(seed)
    return Actor(H, 16, A)


@settings(deadline=None, max_examples=25)
@given(seed=st.integers(0, 10_000), loud=st.floats(0.1, 3.0))
def test_the_log_probability_is_that_of_a_squashed_gaussian(seed, loud):
    actor = an_actor(seed).double()
    x = loud * torch.randn(50, H, dtype=torch.double)
    action, got = sample_action(actor, x)
    mean, log_std = actor(x)
    squashed = torch.distributions.TransformedDistribution(
        torch.distributions.Normal(mean, log_std.exp()), torch.distributions.TanhTransform()
    )
    inside = (action.abs() < 1 - 1e-9).all(-1)  # nearer to 1 the inverse of tanh is lost
    torch.testing.assert_close(got[inside], squashed.log_prob(action).sum(-1)[inside], atol=1e-4, rtol=1e-4)


def test_the_log_probability_stays_finite_where_tanh_is_full():
    actor = an_actor()
    with torch.no_grad():
        actor.mean.bias.fill_(40.0)
    action, log_probability = sample_action(actor, torch.zeros(3, H))
    assert (action == 1.0).all()
    assert log_probability.isfinite().all()


class Bowl(nn.Module):
    """Q = -|a|^2 / 2 s^2, whose integral is known."""

    def __init__(self, scale):
        super().__init__()
        self.scale = scale

    def forward(self, x, action):
        return -(action**2).sum(-1) / (2 * self.scale**2) + 0 * x.sum(-1)


def test_the_sum_over_actions_is_the_integral_whoever_proposes_them():
    scale = 0.2  # narrow: the square [-1, 1]^2 holds all of it
    wanted = math.log(2 * math.pi * scale**2)
    torch.manual_seed(0)
    x = torch.zeros(4, H)
    uniform = torch.rand(40_000, 4, A) * 2 - 1
    density = torch.full((40_000, 4), -A * math.log(2.0))
    got = log_sum_exp(Bowl(scale), x, uniform, density)
    torch.testing.assert_close(got, torch.full((4,), wanted), atol=0.03, rtol=0)
    proposed = sample_action(an_actor(), x.expand(40_000, 4, H))
    got = log_sum_exp(Bowl(scale), x, *proposed)
    torch.testing.assert_close(got, torch.full((4,), wanted), atol=0.03, rtol=0)


def sequences(length, **changes):
    flat = torch.zeros(1, length)
    blank = Sequences(
        kinds=torch.zeros(1, 3, 4, 4),
        place=torch.zeros(1, 3 + length, 16, dtype=torch.int64),
        statistics=torch.zeros(1, 3 + length, 0),
        actions=torch.arange(3 + length).float()[None, :, None].expand(-1, -1, A),
        experts=torch.zeros(1, length, A),
        rewards=torch.arange(length).float()[None],
        done=flat,
        valid=flat + 1,
        start=torch.ones(1),
        height_m=torch.zeros(1),
        log_limits=torch.zeros(1, length, 3),
        lag_s=flat,
        delay_s=flat,
        states=torch.zeros(1, length, len(COLUMNS)),
        beliefs=torch.zeros(1, length, 0),
        responses=torch.zeros(1, length, 0),
        inputs=torch.zeros(1, length, 0),
    )
    return replace(blank, **changes)


def test_a_transition_is_the_action_executed_there_its_reward_and_the_next_feature():
    x = torch.arange(5.0)[None, :, None].expand(-1, -1, H).clone().requires_grad_()
    steps = Transitions.of(x, sequences(5))
    assert steps.actions[0, :, 0].tolist() == [3, 4, 5, 6]  # behind three steps of the past
    assert steps.rewards[0].tolist() == [0, 1, 2, 3]
    assert (steps.x_next - steps.x).detach().unique().tolist() == [1.0]
    assert steps.x.requires_grad
    assert not steps.x_next.requires_grad


def test_the_last_step_of_a_horizon_does_not_count_and_that_of_a_lost_episode_does():
    x, valid = torch.zeros(1, 5, H), torch.tensor([[1.0, 1.0, 1.0, 0.0, 0.0]])
    assert Transitions.of(x, sequences(5, valid=valid)).weight[0].tolist() == [1, 1, 0, 0]
    done = torch.tensor([[0.0, 0.0, 1.0, 0.0, 0.0]])
    assert Transitions.of(x, sequences(5, valid=valid, done=done)).weight[0].tolist() == [1, 1, 1, 0]


@pytest.mark.parametrize(("start", "skipped"), [(1.0, 0), (0.0, BURN_IN)])
def test_amid_an_episode_the_first_steps_only_fill_the_memory(start, skipped):
    length = BURN_IN + 4
    steps = Transitions.of(torch.zeros(1, length, H), sequences(length, start=torch.tensor([start])))
    assert steps.weight[0].tolist() == [0] * skipped + [1] * (length - 1 - skipped)


def test_critics_learn_to_rank_what_was_tried_and_think_little_of_what_was_not():
    """One-step episodes whose reward rises with the first action, of which only the lower half was tried."""
    torch.manual_seed(0)
    config = AdaTrackerConfig(
        size=16, history=3, features=4, context=2, encoder_hidden=4, hidden=H, actor=8, last_action=False
    )
    learner = CqlSac(Agent(config), TrainSettings(recipe="none", method="cql_sac"))
    length, tried = 24, torch.linspace(-1, 0, 16)
    for number in range(150):
        actions = torch.rand(1, 3 + length, A, generator=torch.Generator().manual_seed(number)) - 1
        rewards, once = 5 * actions[:, 3:, 0], torch.ones(1, length)
        learner.update(sequences(length, actions=actions, rewards=rewards, done=once), number)
    with torch.no_grad():
        x = learner.agent.recall(sequences(length)).x[:, -1].expand(16, H)
        worth = [
            learner.critics[0](x, torch.stack((first, torch.full((16,), -0.5)), dim=-1))
            for first in (tried, -tried)
        ]
    assert torch.corrcoef(torch.stack((worth[0], tried)))[0, 1] > 0.9
    assert worth[1].max() < worth[0].max()
