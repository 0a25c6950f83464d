"""Online RL: what a library's PPO learns here is a policy like any other, body after body."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from sb3_contrib import RecurrentPPO

from adatracker_deploy.learning.checkpoint import ADATRACKER_MASK, AdaTracker, load_checkpoint
from adatracker_deploy.learning.environment import TrackingEnv
from adatracker_deploy.learning.rollout import rollout
from adatracker_deploy.learning.train import online_rl
from adatracker_deploy.learning.train.agent import drawn
from adatracker_deploy.learning.train.online_rl import OnlineSettings, Squashed, train_online
from tools import online_rl as command


@pytest.fixture(autouse=True)
def a_small_run(monkeypatch):
    monkeypatch.setattr(online_rl, "BODIES", online_rl.BODIES[:2])
    monkeypatch.setattr(online_rl, "_STEPS", 8)
    monkeypatch.setattr(online_rl, "_BATCH", 32)


def test_the_checkpoint_acts_as_the_library_does(tmp_path):
    said = []
    path = train_online(OnlineSettings(steps=128, seed=3), tmp_path, said.append)
    assert len(said) == 2
    learnt = load_checkpoint(path)
    assert isinstance(learnt, AdaTracker)
    assert learnt.encoder is None
    model = RecurrentPPO.load(tmp_path / "body-01.zip")
    assert model.num_timesteps == 256
    env = Squashed(TrackingEnv(condition="clean", height_m=1.7, target_speed_m_s=1.0, steps=12))
    mask, _ = env.reset(seed=7)
    masks, acted, state, ended = [], [], None, False
    while not ended:
        masks.append(mask)
        raw, state = model.predict(mask, state, episode_start=np.array([state is None]), deterministic=True)
        acted.append(np.tanh(raw))
        mask, _, lost, done, _ = env.step(raw)
        ended = lost or done
    shown = drawn(np.stack(masks)).numpy()
    assert learnt.meta.mask == ADATRACKER_MASK
    np.testing.assert_allclose(rollout(learnt, shown)["action"], acted, atol=1e-4)


def test_a_run_goes_on_after_the_bodies_that_are_finished(tmp_path):
    settings = OnlineSettings(steps=64)
    first = train_online(settings, tmp_path, lambda _text: None)
    weights = torch.load(first, weights_only=True)["state_dict"]
    (tmp_path / "body-01.zip").unlink()
    kept = (tmp_path / "body-00.zip").stat().st_mtime_ns
    said = []
    again = torch.load(train_online(settings, tmp_path, said.append), weights_only=True)["state_dict"]
    assert [line.split(",")[0] for line in said] == ["body 2 of 2"]
    assert (tmp_path / "body-00.zip").stat().st_mtime_ns == kept
    assert weights.keys() == again.keys()


def test_a_wrong_request_is_one_line(tmp_path, capsys):
    assert command.main(["--out", str(tmp_path / "run"), "--steps", "0"]) == 2
    assert command.main(["--out", str(tmp_path / "run"), "--condition", "rain"]) == 2
    few, rain = capsys.readouterr().err.splitlines()
    assert "steps" in few
    assert "unknown condition 'rain'" in rain
    assert not (tmp_path / "run").exists()
