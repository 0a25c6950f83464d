"""Logged trials as training data: what the log says, and NaN for what it does not."""

from __future__ import annotations

from dataclasses import asdict

import numpy as np
import pytest

from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.core.messages import Box, MaskClass, Observation, Twist
from adatracker_deploy.learning.checkpoint import ADATRACKER_MASK
from adatracker_deploy.learning.data.dataset import Dataset
from adatracker_deploy.learning.data.logged import COLUMNS, action_of, read_logged, reduced
from adatracker_deploy.learning.data.shard import unpack_masks
from adatracker_deploy.learning.tracking import ACTION
from adatracker_deploy.learning.train.agent import drawn
from adatracker_deploy.policy.base import to_twist
from adatracker_deploy.policy.drawing import MaskPainter
from adatracker_deploy.trial.reader import read_trial
from tests.learning.logs import LIMITS, PERIOD_NS, a_logged_trial, a_tick
from tests.trial.records import START_NS, a_frame, a_log


def column(steps, name):
    return steps.states[:, COLUMNS.index(name)]


def test_actions_are_what_a_policy_had_to_answer_for_what_was_sent():
    for forward, yaw in ((0.4, -0.9), (-0.3, 0.2), (1.0, 1.0)):
        sent = to_twist(np.array([forward, yaw], np.float32), ACTION, LIMITS)
        assert action_of(sent, LIMITS) == pytest.approx((forward, yaw))


def test_a_step_is_the_mask_the_sent_action_and_the_next_ticks_reward(tmp_path):
    log = a_logged_trial(tmp_path, 12, outcome="lost")
    ((header, steps),) = read_logged(log)
    trial = read_trial(log)
    assert header.steps == len(steps) == 11
    masks = {mask.seq: mask.mask for mask in trial.masks()}
    for place, tick in enumerate(trial.steps[:-1]):
        assert np.array_equal(unpack_masks(steps.masks[place]), reduced(masks[tick.frame_seq]))
        assert steps.actions[place] == pytest.approx(action_of(tick.sent, LIMITS))
    assert steps.rewards[0] == pytest.approx(1 / (1 + trial.steps[1].box.cx - trial.steps[0].box.cx))
    assert steps.done.tolist() == [False] * 10 + [True]
    assert not steps.dropped.any()


def test_a_mask_is_the_policys_own_view_of_it():
    rng = np.random.default_rng(3)
    mask = np.kron(rng.integers(0, 4, (6, 8)), np.ones((20, 20))).astype(np.uint8)
    seen = MaskPainter(ADATRACKER_MASK).paint(mask)
    assert np.allclose(drawn(reduced(mask)).numpy(), seen)


def test_states_are_what_was_measured(tmp_path):
    ((_, steps),) = read_logged(a_logged_trial(tmp_path, 8, gone=(4, 5)))
    assert np.isfinite(steps.states).all()
    assert np.isfinite(steps.finals).all()
    assert column(steps, "visible").tolist() == [1, 1, 1, 1, 0, 0, 1]
    assert column(steps, "lost") == pytest.approx(np.array([0, 0, 0, 0, 1, 2, 0]) / 50)
    off = column(steps, "off_x")
    assert off[4] == off[5] == off[3] > 0
    moved = column(steps, "moved_x")
    assert moved[0] == moved[4] == moved[5] == moved[6] == 0
    assert moved[1:4] == pytest.approx(np.diff(off[:4]))
    assert np.array_equal(steps.states[1:, COLUMNS.index("forward_1")], steps.actions[:-1, 0])
    assert column(steps, "log_yaw") == pytest.approx(np.log(LIMITS.yaw_rate_rad_s))


def test_what_a_log_lacks_is_nan_and_nothing_else_is(tmp_path):
    a_logged_trial(tmp_path, 30)
    data = Dataset.open([tmp_path])
    assert data.logged
    batch = data.sample(np.random.default_rng(0), 4, 12, 5)
    assert np.isnan(batch.experts[batch.valid]).all()
    for name in ("height_m", "lag_s", "delay_s"):
        assert np.isnan(getattr(batch, name)).all(), name
    for name in ("actions", "rewards", "log_limits", "states"):
        assert np.isfinite(getattr(batch, name)).all(), name


def test_shards_and_trials_are_not_mixed(tmp_path):
    a_logged_trial(tmp_path / "trials", 5)
    (tmp_path / "data").mkdir()
    (tmp_path / "data" / "shard-00000.npz").write_bytes(b"")
    with pytest.raises(UsageError, match="their rewards differ"):
        Dataset.open([tmp_path])


@pytest.mark.parametrize(
    ("period_ns", "sent", "config", "told"),
    [
        (PERIOD_NS // 2, Twist(vx=0.1), {"limits": asdict(LIMITS)}, "rate is 20.0 Hz"),
        (PERIOD_NS, Twist(vy=0.2), {"limits": asdict(LIMITS)}, "drove sideways"),
        (PERIOD_NS, Twist(vx=0.1), {"name": "x"}, "lacks the robot's limits"),
    ],
)
def test_a_trial_that_cannot_be_learned_from_is_refused_by_name(tmp_path, period_ns, sent, config, told):
    with a_log(tmp_path, config={"profile": config}) as log:
        for number in range(4):
            tick = a_tick(number, Box(0.5, 0.5, 0.2, 0.4), t_ns=START_NS + number * period_ns, sent=sent)
            mask = np.full((12, 16), MaskClass.TARGET, np.uint8)
            seen = Observation(mask, tick.box, 0.9, tick.t_ns, number)
            log.step(tick, a_frame(number), seen)
        log.close({"outcome": "completed"})
    with pytest.raises(UsageError, match=told):
        Dataset.open([tmp_path])
