"""Improving a policy by its own rewards: no label enters, and it goes where the reward is."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.learning.data.collect import collect
from adatracker_deploy.learning.data.dataset import Dataset
from adatracker_deploy.learning.data.recipe import load_recipe
from adatracker_deploy.learning.data.state import COLUMNS
from adatracker_deploy.learning.train import td3
from adatracker_deploy.learning.train.agent import Agent, Sequences, inputs_of
from adatracker_deploy.learning.train.run import train
from adatracker_deploy.learning.train.settings import TrainSettings
from adatracker_deploy.learning.train.td3 import Td3

pytestmark = pytest.mark.slow

SETTINGS = TrainSettings(
    recipe="paper", method="td3", init="adatracker", updates=400, critic_updates=100, rate=1e-3
)
BEST = torch.tensor([0.5, -0.5])


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("data")
    collect(load_recipe("paper"), folder, steps=600, seed=3)
    return folder


def a_learner(settings=SETTINGS):
    torch.manual_seed(0)
    return Td3(Agent(settings.config()), settings)


@pytest.fixture(scope="module")
def data(folder):
    plain = Dataset.open([folder])
    return plain.with_inputs(inputs_of(a_learner().agent, plain))


def a_batch(data, number, length=20):
    return Sequences.of(data.sample(np.random.default_rng(number), 8, length, 16))


def one_step_games(data, number):
    """Return steps that each end their episode, with the less reward the further they were from the best."""
    found = a_batch(data, number)
    executed = torch.rand(8, 20, 2, generator=torch.Generator().manual_seed(number)) * 2 - 1
    return replace(
        found,
        actions=torch.cat((found.actions[:, :-20], executed), dim=1),
        rewards=-((executed - BEST) ** 2).sum(-1),
        done=torch.ones(8, 20),
        valid=torch.ones(8, 20),
    )


def distances(learner, sequences):
    """Return how far the action is from the best along each axis, (2,), while the memory is not empty."""
    with torch.no_grad():
        x, _ = learner.agent.policy.remember(sequences.inputs)
        return (torch.tanh(learner.agent.policy.actor(x)[0]) - BEST).abs()[:, 5:].mean((0, 1))


@pytest.mark.parametrize(("late", "anchor"), [(False, td3._ANCHOR), (True, td3._ANCHOR_LATE)])
def test_a_policy_goes_where_the_reward_is_until_that_gains_less_than_the_anchor_asks(data, late, anchor):
    settings = replace(SETTINGS, updates=1200, critic_updates=800, late=late)
    learner = a_learner(settings)
    assert learner.prepare(data, print)
    before = distances(learner, a_batch(data, 0))
    for number in range(settings.updates):
        told = learner.update(one_step_games(data, number), number)
        assert ("apart" in told) is (number >= settings.critic_updates and number % 2 == 0)
    # At a distance d the reward rises by 2 d for each step nearer; here rewards are the values.
    spread = float(learner.critics.spread)
    reach = td3._reach(a_batch(data, 0).states, late=late).mean((0, 1))
    held = anchor * spread * reach / (2 * (1 - td3._DISCOUNT))
    after = distances(learner, a_batch(data, 0))
    assert (held < 0.7 * before).all()
    assert after.tolist() == pytest.approx(held.tolist(), abs=0.08)


def test_the_anchor_asks_by_what_an_axis_moves_of_the_reward(data):
    states = a_batch(data, 0).states[:1, :1].clone()
    states[..., COLUMNS.index("log_forward")] = float(np.log(1.5))
    states[..., COLUMNS.index("log_yaw")] = float(np.log(np.radians(120)))
    forward, yaw = td3._reach(states).flatten().tolist()
    assert yaw == pytest.approx(1)
    # At 120 deg/s a step is worth 12 of 45 degrees, at 1.5 m/s 0.15 of 7.5 m.
    assert forward == pytest.approx(td3._FORWARD_WEIGHT * (0.15 / 7.5) / (12 / 45))
    states[..., COLUMNS.index("lag_s")] = 0.75 * td3._LATE_S
    states[..., COLUMNS.index("delay_s")] = 0.25 * td3._LATE_S
    assert td3._reach(states).flatten().tolist() == pytest.approx([2 * forward, 2])
    assert td3._reach(states, late=True).flatten().tolist() == pytest.approx([forward, 1])
    states[..., COLUMNS.index("visible")] = 0
    assert td3._reach(states).flatten().tolist() == [1, 1]


def test_where_nothing_follows_within_the_horizon_a_reward_teaches_nothing(data):
    def weights_after(reward, *, ends):
        learner = a_learner()
        learner.prepare(data, print)
        batch = one_step_games(data, 1)
        rewards, done = batch.rewards.clone(), torch.zeros_like(batch.done)
        rewards[:, -1], done[:, -1] = reward, ends
        learner.update(replace(batch, rewards=rewards, done=done), 0)
        return learner.critics.state_dict()

    def same(one, other):
        return all(torch.equal(one[name], other[name]) for name in one)

    assert same(weights_after(0.0, ends=0.0), weights_after(9.0, ends=0.0))
    assert not same(weights_after(0.0, ends=1.0), weights_after(9.0, ends=1.0))


def test_no_label_of_the_expert_enters(data):
    def weights_after(data):
        learner = a_learner(replace(SETTINGS, updates=4, critic_updates=1))
        learner.prepare(data, print)
        for number in range(4):
            learner.update(a_batch(data, number), number)
        return learner.agent.state_dict()

    blind = Dataset.__new__(Dataset)
    blind.__dict__ = data.__dict__ | {
        "steps": replace(data.steps, experts=np.full_like(data.steps.experts, np.nan))
    }
    plain = weights_after(data)
    for name, value in weights_after(blind).items():
        assert torch.equal(value, plain[name]), name


def test_critics_standardise_by_the_first_data_but_what_hardly_varies_there(data):
    learner = a_learner()
    learner.prepare(data, print)
    assert not learner.prepare(data, print)
    critics, count = learner.critics, len(COLUMNS)
    np.testing.assert_allclose(critics.mean[:count], data.steps.states.mean(0), rtol=1e-4, atol=1e-5)
    assert critics.std[COLUMNS.index("fov_deg")] == pytest.approx(0.05)
    assert len(critics.mean) > count
    assert (critics.std[count:] == 1).all()


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"init": None}, "name its run or bundle by --init"),
        ({"variants": ("no-search",)}, "--variant no-search: td3 leaves"),
        ({"late": True, "response": True, "method": "awr", "init": None}, "--late: only --method td3"),
        ({"late": True}, "--late: only --method td3"),
    ],
)
def test_what_it_makes_nothing_of_is_refused(folder, tmp_path, change, reason):
    with pytest.raises(UsageError, match=reason):
        train(replace(SETTINGS, **change), [folder], tmp_path / "out", say=print, tell=print)
    assert not (tmp_path / "out").exists()
