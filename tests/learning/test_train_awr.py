"""Offline reinforcement learning: critics that tell good actions, and a policy that sees no expert."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from adatracker_deploy.learning.data.collect import collect
from adatracker_deploy.learning.data.dataset import Dataset
from adatracker_deploy.learning.data.recipe import load_recipe
from adatracker_deploy.learning.train.agent import Agent, Sequences
from adatracker_deploy.learning.train.awr import Awr
from adatracker_deploy.learning.train.critics import StateCritics
from adatracker_deploy.learning.train.settings import TrainSettings
from tests.tiers import EXHAUSTIVE

pytestmark = pytest.mark.slow

SETTINGS = TrainSettings(recipe="paper", method="awr", updates=3, batch=2, length=20, critic_updates=150)


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    folder = tmp_path_factory.mktemp("data")
    collect(load_recipe("paper"), folder, steps=3000, seed=3)
    return Dataset.open([folder])


def weights_after(data, settings=SETTINGS):
    torch.manual_seed(0)
    learner = Awr(Agent(settings.config()), settings)
    learner.prepare(data, print)
    for number in range(settings.updates):
        rng = np.random.default_rng(number)
        learner.update(Sequences.of(data.sample(rng, settings.batch, settings.length, 16)), number)
    return learner.agent.state_dict()


def test_neither_a_label_of_the_expert_nor_anything_else_but_logged_steps_enters(data, monkeypatch):
    plain = weights_after(data)
    blind = Dataset.__new__(Dataset)
    blind.__dict__ = data.__dict__ | {
        "steps": replace(data.steps, experts=np.full_like(data.steps.experts, np.nan))
    }
    monkeypatch.setattr("adatracker_deploy.learning.data.rollout.Rollout.__init__", None)
    monkeypatch.setattr("adatracker_deploy.learning.expert.Expert.__init__", None)
    for name, value in weights_after(blind).items():
        assert torch.equal(value, plain[name]), name


@EXHAUSTIVE
def test_critics_prefer_the_clean_action_to_the_perturbed_one(data):
    """Which of the two was executed is all that they are told; the clean one is known here alone."""
    torch.manual_seed(0)
    critics = StateCritics()
    critics.fit(data, updates=600, conservative=0.0, seed=1)
    states, executed = (torch.from_numpy(values) for values in (data.steps.states, data.steps.actions))
    clean = torch.from_numpy(data.steps.experts)
    apart = (clean - executed).abs().sum(-1) > 0.4
    with torch.no_grad():
        better = critics.values(states, clean).mean(0) > critics.values(states, executed).mean(0)
    assert better[apart].float().mean() > 0.6


def test_the_same_seed_gives_the_same_critics_and_they_are_fitted_once(data):
    def learner():
        torch.manual_seed(0)
        return Awr(Agent(SETTINGS.config()), SETTINGS)

    one, other, resumed = learner(), learner(), learner()
    said = []
    assert one.prepare(data, said.append)
    assert not one.prepare(data, said.append)
    other.prepare(data, print)
    resumed.load_state_dict(one.state_dict())
    assert not resumed.prepare(data, said.append)
    assert said[0] == "fitting the critics to the true states"
    assert "150 updates" in said[1]
    assert len(said) == 2
    fitted = one.critics.state_dict()
    for name in fitted:
        assert torch.equal(fitted[name], other.critics.state_dict()[name]), name
        assert torch.equal(fitted[name], resumed.critics.state_dict()[name]), name


@pytest.mark.parametrize("conservative", [0.0, 0.05])
def test_a_conservative_weight_keeps_values_finite(data, conservative):
    critics = StateCritics()
    told = critics.fit(data, updates=20, conservative=conservative, seed=0)
    assert all(np.isfinite(value) for value in told.values())
    assert critics.fitted
