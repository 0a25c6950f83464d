"""A body that changes on the way: an action then means less, and everybody who knows the truth is told."""

from __future__ import annotations

import numpy as np
import pytest

from adatracker_deploy.learning.change import Change
from adatracker_deploy.learning.data.rollout import Rollout
from adatracker_deploy.learning.data.state import COLUMNS
from adatracker_deploy.learning.embodiment import Embodiment
from adatracker_deploy.learning.episode_spec import EpisodeSpec
from adatracker_deploy.learning.seeds import TUNING
from adatracker_deploy.learning.tracking import Tracking

BODY = Embodiment(forward_m_s=2.0, backward_m_s=1.0, yaw_rate_rad_s=1.5, lag_s=0.0)
CHANGE = Change(at_step=20, forward=0.5, yaw=0.4, more_lag_s=0.3)


def spec_of(**changes):
    return EpisodeSpec(seed=TUNING[3], embodiment=BODY, target_speed_m_s=0.7, **changes)


@pytest.mark.parametrize("kind", ["differential", "quadruped"])
def test_an_action_of_one_brings_less_speed_and_later(kind):
    spec = spec_of(change=CHANGE)
    tracking = Tracking(spec)
    tracking.begin()
    turned = []
    for _ in range(60):
        tracking.step(np.float32([0.0, 1.0]))
        turned.append(tracking.task.body.velocity.yaw_rate)
    assert turned[:20] == pytest.approx([1.5] * 20)
    assert turned[20] == pytest.approx(0.6 + 0.9 * np.exp(-0.1 / 0.3))
    assert turned[-1] == pytest.approx(0.6, abs=1e-3)


def test_the_expert_knows_and_keeps_its_target():
    rewards = []
    for change in (None, CHANGE):
        rollout = Rollout(spec_of(change=change), 200)
        while not rollout.ended:
            rollout.step(rollout.expert)
        _, steps = rollout.record()
        rewards.append(steps.rewards[30:].mean())
    assert rewards[1] > 0.9
    assert rewards[0] >= rewards[1] - 0.02


def test_the_true_states_hold_what_the_body_is_at_each_step():
    rollout = Rollout(spec_of(change=CHANGE), 40)
    while not rollout.ended:
        rollout.step(rollout.expert)
    _, steps = rollout.record()
    lag, yaw = (steps.states[:, COLUMNS.index(name)] for name in ("lag_s", "log_yaw"))
    assert lag == pytest.approx([0.0] * 20 + [0.3] * 20)
    assert np.exp(yaw) == pytest.approx([1.5] * 20 + [0.6] * 20)


def test_without_a_change_the_body_stays_what_it_was():
    tracking = Tracking(spec_of())
    tracking.begin()
    for _ in range(30):
        tracking.step(np.float32([0.0, 1.0]))
    assert tracking.embodiment == BODY
