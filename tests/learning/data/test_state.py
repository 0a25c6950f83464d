"""The true state that critics see: what it says of a step, by hand."""

import math

import numpy as np
import pytest

from adatracker_deploy.learning.data.rollout import Rollout
from adatracker_deploy.learning.data.state import COLUMNS, REMEMBERED
from adatracker_deploy.learning.embodiment import Embodiment
from adatracker_deploy.learning.episode_spec import EpisodeSpec

BODY = Embodiment(height_m=1.2, pitch_deg=5.0, forward_m_s=2.0, backward_m_s=0.0, lag_s=0.0, delay_s=0.0)


def rows(actions, body=BODY):
    rollout = Rollout(EpisodeSpec(seed=5, embodiment=body), 50)
    for action in actions:
        rollout.step(np.array(action, np.float32))
    _, steps = rollout.record()
    return [dict(zip(COLUMNS, row, strict=True)) for row in (*steps.states, *steps.finals)], steps


def test_an_episode_begins_behind_the_target_with_nothing_done():
    first = rows([(0.0, 0.0)])[0][0]
    assert first["too_far_m"] == pytest.approx(0.0, abs=1e-5)
    assert first["bearing_rad"] == pytest.approx(0.0, abs=1e-5)
    assert first["ahead_m"] == pytest.approx(2.5, abs=1e-5)
    assert (first["height_m"], first["pitch_deg"]) == (pytest.approx(1.2), pytest.approx(5.0))
    assert first["log_forward"] == pytest.approx(math.log(2.0))
    assert first["log_backward"] == pytest.approx(math.log(0.05))
    assert first["visible"] == 1.0
    assert all(
        first[f"{axis}_{age}"] == 0.0 for axis in ("forward", "yaw") for age in range(1, REMEMBERED + 1)
    )


def test_turning_left_moves_the_target_to_the_right_and_is_remembered():
    told, _ = rows([(0.0, 1.0), (0.0, -1.0)])
    assert told[1]["bearing_rad"] < -0.1
    assert told[1]["left_m"] < 0.0
    assert (told[1]["yaw_1"], told[2]["yaw_1"], told[2]["yaw_2"]) == (1.0, -1.0, 1.0)


def test_the_state_before_a_step_is_in_its_row_and_the_last_one_after_it_in_the_end():
    told, steps = rows([(1.0, 0.0)] * 6)
    assert len(steps.states) == 6
    assert steps.finals.shape == (1, len(COLUMNS))
    assert told[1]["forward_m_s"] == pytest.approx(2.0, abs=0.3)
    target = math.hypot(told[-1]["target_ahead_m_s"], told[-1]["target_left_m_s"])
    assert 0.0 <= target < 6.0


def test_lost_steps_are_counted_and_forgotten_when_it_is_seen_again():
    told, steps = rows([(0.0, 1.0)] * 12)
    lost = [round(row["lost"] * 50) for row in told]
    assert max(lost) > 0
    for before, after, visible in zip(lost, lost[1:], steps.visible, strict=False):
        assert after == (0 if visible else before + 1)
