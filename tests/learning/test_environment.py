"""The task is a proper Gymnasium environment with the paper's rules, and the simulator's on request."""

from __future__ import annotations

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import adatracker_deploy.gym  # noqa: F401 -- registers them
from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.core.messages import MaskClass
from adatracker_deploy.core.task import step_reward
from adatracker_deploy.learning.conditions import make_cell
from adatracker_deploy.learning.environment import TrackingEnv
from adatracker_deploy.learning.seeds import TUNING

IDS = ("AdaTracker-v0", "AdaTrackerClean-v0", "AdaTrackerField-v0", "AdaTrackerHard-v0")
STAND = np.zeros(2, np.float32)
SPIN = np.array([0.0, 1.0], np.float32)


@pytest.mark.filterwarnings("ignore:.*pixel:UserWarning")
@pytest.mark.parametrize("name", IDS)
def test_gymnasiums_own_checker_is_content(name):
    check_env(gymnasium.make(name).unwrapped, skip_render_check=False)


def test_rgb_is_observed_on_request_and_rendered():
    env = TrackingEnv(condition="field", observe="rgb", render_mode="rgb_array")
    seen, _ = env.reset(seed=TUNING[0])
    assert env.observation_space.contains(seen)
    assert seen.shape == (64, 64, 3)
    assert env.render().shape == (256, 256, 3)


def test_the_reward_is_the_papers_and_info_tells_the_truth():
    env = TrackingEnv(condition="field", height_m=1.0, target_speed_m_s=1.0)
    seen, info = env.reset(seed=TUNING[1])
    assert (seen == MaskClass.TARGET).any()
    assert info["distance_m"] == pytest.approx(2.5, abs=0.5)
    for _ in range(5):
        _, reward, _, _, info = env.step(STAND)
        assert reward == step_reward(info["distance_m"], info["bearing_rad"])
    assert (info["height_m"], info["forward_m_s"]) == (1.0, 1.3)
    assert 0.1 <= info["lag_s"] <= 0.4


def test_positive_numbers_go_forward_and_turn_to_the_left():
    env = TrackingEnv(condition="clean", height_m=1.0, target_speed_m_s=1.0)
    env.reset(seed=TUNING[2])
    body = env.tracking.task.body
    before = body.pose
    env.step(np.array([1.0, 0.5], np.float32))
    assert body.velocity.vx > 0
    assert (body.pose.yaw - before.yaw) % 6.28 < 3.14


@pytest.mark.parametrize(("rules", "steps"), [("paper", 50), ("simulator", 51)])
def test_a_target_that_is_lost_for_long_enough_ends_the_episode(rules, steps):
    env = TrackingEnv(condition="clean", height_m=1.0, target_speed_m_s=0.5, rules=rules, steps=1000)
    env.reset(seed=TUNING[3])
    lost = rewards = 0
    least = 0.0
    ended = False
    while not ended:
        away = abs(env.tracking.task.body.pose.bearing_to(*env.tracking.task.world.target_xy))
        _, reward, ended, cut, info = env.step(SPIN if away < 3.0 else STAND)
        lost = 0 if info["visible"] else lost + 1
        least = min(least, reward)
        rewards += 1
        assert not cut
    assert lost == steps
    assert (least < -1.0) is (rules == "paper")


def test_the_horizon_truncates():
    env = TrackingEnv(condition="clean", steps=3)
    env.reset(seed=TUNING[4])
    assert [env.step(STAND)[2:4] for _ in range(3)] == [(False, False), (False, False), (False, True)]


def test_equal_seeds_are_equal_episodes_and_a_spec_can_be_given_whole():
    spec = make_cell("hard", 0.3, 2.0, TUNING[5])
    one, two = TrackingEnv(condition="clean"), TrackingEnv()
    first, _ = one.reset(options={"spec": spec})
    again, _ = two.reset(options={"spec": spec})
    assert np.array_equal(first, again)
    for _ in range(30):
        a, b = one.step(SPIN), two.step(SPIN)
        assert np.array_equal(a[0], b[0])
        assert a[1] == b[1]


def test_an_unknown_condition_or_recipe_is_one_clear_line():
    with pytest.raises(UsageError, match="unknown condition"):
        TrackingEnv(condition="wet")
    with pytest.raises(UsageError, match="unknown recipe"):
        TrackingEnv(recipe="soup")


def test_a_step_before_the_first_reset_is_refused():
    with pytest.raises(gymnasium.error.ResetNeeded):
        TrackingEnv().step(STAND)
