"""Each loss is what its formula says, counts only the steps that count, and is least where it should be."""

from __future__ import annotations

import math

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from adatracker_deploy.learning import losses

B, L, A, Z = 3, 7, 2, 4


def drawn(seed, *shape):
    return torch.randn(*shape, generator=torch.Generator().manual_seed(seed))


def some_weight(seed):
    weight = (drawn(seed + 1, B, L) > 0).float()
    weight[0, 0] = 1.0
    return weight


EACH = {
    "cloning": lambda x, weight: losses.cloning_loss(x[..., :A], torch.tanh(drawn(9, B, L, A)), weight),
    "reward": lambda x, weight: losses.reward_loss(x[..., 0], drawn(9, B, L), weight),
    "height": lambda x, weight: losses.height_loss(x[..., 0], drawn(9, B), weight),
    "dynamics": lambda x, weight: losses.dynamics_loss(x, drawn(9, B, L, 4), weight),
    "consistency": lambda x, weight: losses.consistency_loss(x, torch.ones(B), weight, first=L),
}


@pytest.mark.parametrize("name", EACH)
@settings(deadline=None, max_examples=20)
@given(seed=st.integers(0, 10_000))
def test_what_does_not_count_changes_nothing(name, seed):
    x, weight = drawn(seed, B, L, Z), some_weight(seed)
    changed = torch.where(weight[..., None] > 0, x, drawn(seed + 2, B, L, Z))
    torch.testing.assert_close(EACH[name](changed, weight), EACH[name](x, weight))


@pytest.mark.parametrize("name", EACH)
def test_no_steps_cost_nothing(name):
    assert EACH[name](drawn(0, B, L, Z), torch.zeros(B, L)) == 0


@pytest.mark.parametrize("name", EACH)
def test_its_gradient_reaches_the_steps_that_count_and_no_others(name):
    x, weight = drawn(1, B, L, Z).requires_grad_(), some_weight(1)
    EACH[name](x, weight).backward()
    touched = x.grad.abs().sum(-1) > 0
    assert torch.equal(touched, weight > 0)


def test_cloning_is_the_squared_error_of_the_deployed_action_near_the_experts():
    mean, experts = torch.full((1, 1, 2), math.atanh(0.5)), torch.tensor([[[0.2, 0.5]]])
    got = losses.cloning_loss(mean, experts, torch.ones(1, 1))
    assert got.item() == pytest.approx(0.5 * 0.3**2, rel=1e-5)


def test_a_hopeless_step_pulls_no_harder_than_a_bad_one():
    experts = torch.tensor([[[1.0, 0.0]]])

    def pull(action):
        mean = torch.tensor([[[math.atanh(action), 0.0]]], requires_grad=True)
        losses.cloning_loss(mean, experts, torch.ones(1, 1)).backward()
        return abs(mean.grad[0, 0, 0].item()) / (1 - action**2)

    assert pull(-0.9) == pytest.approx(pull(0.4), rel=1e-4)
    assert pull(0.9) < pull(0.4)


def test_rewards_and_heights_cost_their_mean_squared_errors():
    predicted, weight = torch.tensor([[1.0, 2.0, 9.0]]), torch.tensor([[1.0, 1.0, 0.0]])
    assert losses.reward_loss(predicted, torch.tensor([[0.0, 0.0, 0.0]]), weight) == pytest.approx(2.5)
    assert losses.height_loss(predicted, torch.tensor([2.0]), weight) == pytest.approx(0.5)


def test_dynamics_are_the_forward_and_yaw_limit_the_lag_and_the_delay_in_their_units():
    limits = torch.log(torch.tensor([[2.0, 1.0, 3.0]]))
    got = losses.dynamics_targets(limits, torch.tensor([0.3]), torch.tensor([0.2]))
    wanted = [math.log(2.0) / 0.5, math.log(3.0) / 0.25, 0.3 / 0.15, 0.2 / 0.1]
    assert got[0].tolist() == pytest.approx(wanted, rel=1e-5)


@settings(deadline=None, max_examples=30)
@given(seed=st.integers(0, 10_000))
def test_contexts_that_never_turn_are_consistent_and_others_cost_up_to_two(seed):
    steady = drawn(seed, B, 1, Z) * (drawn(seed + 1, B, L, 1).abs() + 0.1)
    everything = torch.ones(B, L), 3
    assert losses.consistency_loss(steady, torch.ones(B), *everything) == pytest.approx(0.0, abs=1e-5)
    turning = losses.consistency_loss(drawn(seed, B, L, Z), torch.ones(B), *everything)
    assert 0.0 <= turning <= 2.0


def test_only_the_first_contexts_of_an_episode_are_held_to_its_average():
    z = torch.tensor([[[0.0, 1.0], [1.0, 0.0], [1.0, 0.0]]])
    average = z.mean(1)
    wanted = 1.0 - torch.cosine_similarity(average, z[:, 0]).item()
    assert losses.consistency_loss(z, torch.ones(1), torch.ones(1, 3), first=1) == pytest.approx(wanted)
    assert losses.consistency_loss(z, torch.zeros(1), torch.ones(1, 3), first=1) == 0.0
