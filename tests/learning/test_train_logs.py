"""Training from logged trials: by cloning and by offline reinforcement learning, without expert or truth."""

from __future__ import annotations

import pytest
import torch

from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.learning import losses
from adatracker_deploy.learning.checkpoint import load_checkpoint
from adatracker_deploy.learning.train.run import train
from adatracker_deploy.learning.train.settings import TrainSettings
from adatracker_deploy.learning.train.snapshot import read_snapshot
from tests.learning.logs import a_logged_trial


@pytest.fixture(scope="module")
def trials(tmp_path_factory):
    folder = tmp_path_factory.mktemp("trials")
    a_logged_trial(folder / "a", 40)
    a_logged_trial(folder / "b", 60, outcome="lost", gone=range(50, 60))
    return folder


def trained(trials, out, method, resume=False, updates=3):
    settings = TrainSettings(
        recipe="deploy", method=method, updates=updates, batch=2, length=20, critic_updates=20
    )
    said = []
    path = train(settings, [trials], out, resume=resume, say=said.append, tell=lambda *_: None)
    return path, said


@pytest.mark.parametrize("method", ["cloning", "awr", "cql_sac"])
def test_a_policy_is_trained_from_logs_alone(trials, tmp_path, method, monkeypatch):
    monkeypatch.setattr("adatracker_deploy.learning.data.rollout.Rollout.__init__", None)  # no world
    path, said = trained(trials, tmp_path / "run", method)
    snapshot = read_snapshot(tmp_path / "run")
    assert snapshot.settings.logs
    assert all(value.isfinite().all() for value in snapshot.learner["agent"].values())
    assert "logged trials" in load_checkpoint(path).meta.training
    assert "fitting the critics to the measured states" in said or method != "awr"
    with pytest.raises(UsageError, match="holds a run"):
        trained(trials, tmp_path / "run", method)
    assert trained(trials, tmp_path / "run", method, resume=True)[0] == path


@pytest.mark.parametrize(
    ("method", "why"), [("dagger", "asks an expert, whom"), ("td3", "the true state, which")]
)
def test_what_asks_for_more_than_logs_hold_is_refused(trials, tmp_path, method, why):
    with pytest.raises(UsageError, match=f"{why} logged trials do not have"):
        trained(trials, tmp_path / "run", method)
    assert not (tmp_path / "run").exists()


def test_what_is_not_known_of_a_body_costs_nothing_and_teaches_nothing():
    predicted = torch.randn(2, 3, 4, requires_grad=True)
    nan = float("nan")
    targets = losses.dynamics_targets(
        torch.zeros(2, 3, 3),
        torch.tensor([nan, 0.1])[:, None].expand(2, 3),
        torch.tensor([nan, 0.2])[:, None].expand(2, 3),
    )
    losses.dynamics_loss(predicted, targets, torch.ones(2, 3)).backward()
    unknown = torch.isnan(targets)
    assert (predicted.grad[unknown] == 0).all()
    assert (predicted.grad[~unknown] != 0).all()
    heights = torch.randn(2, 3, requires_grad=True)
    losses.height_loss(heights, torch.tensor([nan, 1.2]), torch.ones(2, 3)).backward()
    assert (heights.grad[0] == 0).all()
    assert (heights.grad[1] != 0).all()


def test_cloning_learns_what_was_done(trials, tmp_path):
    """In these logs the turn follows from where the target is seen."""
    told = []
    settings = TrainSettings(recipe="deploy", method="cloning", updates=80, batch=4, length=20)
    train(settings, [trials], tmp_path, say=lambda _: None, tell=lambda _, loss: told.append(loss))
    assert sum(told[-10:]) < 0.5 * sum(told[:10])
