"""Where an action leads: as the simulation then went, and by hand."""

import math
from dataclasses import replace

import numpy as np
import pytest
import torch

from adatracker_deploy.core.task import DESIRED_DISTANCE_M
from adatracker_deploy.learning.data.collect import collect
from adatracker_deploy.learning.data.dataset import Dataset
from adatracker_deploy.learning.data.recipe import Between, OneOf, load_recipe
from adatracker_deploy.learning.data.state import COLUMNS
from adatracker_deploy.learning.train.agent import Sequences
from adatracker_deploy.learning.train.foresight import FORESEEN, Foresight

PAST = 16


@pytest.fixture(scope="module")
def episodes(tmp_path_factory):
    """Bodies of many lags and delays that nothing is in the way of, as logged: from the start, and amid."""
    folder = tmp_path_factory.mktemp("data")
    recipe = replace(
        load_recipe("paper"),
        episode_steps=60,
        lag_s=Between(low=0.0, high=1.0),
        delay_steps=OneOf(one_of=(0, 1, 3, 6)),
        backward_share=Between(low=0.3, high=1.0),
    )
    collect(recipe, folder, steps=960, seed=5)
    data = Dataset.open([folder])
    every = np.arange(len(data.headers))
    return [Sequences.of(data.take(every, np.full_like(every, at), 40, PAST)) for at in (0, 20)]


def told(foreseen):
    return dict(zip(FORESEEN, foreseen.unbind(-1), strict=True))


def test_the_step_in_which_an_action_begins_to_work_ends_as_it_then_did(episodes):
    for logged in episodes:
        length = logged.valid.shape[1]
        foreseen = told(Foresight(logged.states, logged.actions, logged.valid).of(logged.actions[:, PAST:]))
        later = torch.arange(length) + 1 + (logged.delay_s * 10).round().long()
        known = later < length
        assert set(later[:, 0].tolist()) == {1, 2, 4, 7}
        for name, column, unit in (("bearing", "bearing_rad", 0.5), ("too_far", "too_far_m", 1.0)):
            then = logged.states[..., COLUMNS.index(column)].gather(1, later.clamp(max=length - 1))
            ours = foreseen[f"{name}_after_1"] * unit
            torch.testing.assert_close(ours[known], then[known], atol=1e-4, rtol=0)


def standing(*, delay_s=0.0, lag_s=0.0):
    """Return three steps of a body that stands, 3.5 m behind a target that does."""
    values = dict.fromkeys(COLUMNS, 0.0) | {
        "ahead_m": DESIRED_DISTANCE_M + 1.0,
        "too_far_m": 1.0,
        "log_backward": math.log(0.5),
        "delay_s": delay_s,
        "lag_s": lag_s,
    }
    return torch.tensor(list(values.values())).expand(1, 3, -1)


def foreseen_of(action, before=(0.0, 0.0), **body):
    actions = torch.tensor([[before] * 2 + [(0.0, 0.0)] * 3])
    foresight = Foresight(standing(**body), actions, torch.ones(1, 3))
    return {name: float(value[0, 0]) for name, value in told(foresight.of(torch.tensor(action))).items()}


@pytest.mark.parametrize("delay_s", [0.0, 0.2, 0.6])
def test_an_action_is_held_once_it_works(delay_s):
    found = foreseen_of([[(1.0, 0.0)] * 3], delay_s=delay_s)
    assert [found[f"too_far_after_{steps}"] for steps in (1, 2, 4)] == pytest.approx(
        [0.9, 0.8, 0.6], abs=1e-4
    )
    assert found["bearing_after_4"] == pytest.approx(0.0)
    back = foreseen_of([[(-1.0, 0.0)] * 3], delay_s=delay_s)
    assert back["distance_off_after_4"] == pytest.approx(1.2, abs=1e-4)
    left = foreseen_of([[(0.0, 0.5)] * 3], delay_s=delay_s)
    assert left["bearing_after_2"] == pytest.approx(-0.1 / 0.5)
    assert left["bearing_size_after_2"] == pytest.approx(0.1 / 0.5)


def test_what_was_given_before_works_first():
    found = foreseen_of([[(0.0, 0.0)] * 3], before=(1.0, 0.0), delay_s=0.2)
    assert found["too_far_after_4"] == pytest.approx(0.8, abs=1e-4)
    assert foreseen_of([[(0.0, 0.0)] * 3], before=(1.0, 0.0))["too_far_after_4"] == pytest.approx(
        1.0, abs=1e-4
    )


def test_a_body_with_lag_comes_less_far():
    found = foreseen_of([[(1.0, 0.0)] * 3], lag_s=0.5)
    assert found["too_far_after_1"] == pytest.approx(1 - 0.1 * (1 - math.exp(-0.2)), abs=1e-4)


def test_the_gradient_goes_through_the_action():
    actions = torch.zeros(1, 3, 2, requires_grad=True)
    foresight = Foresight(standing(delay_s=0.6), torch.zeros(1, 5, 2), torch.ones(1, 3))
    told(foresight.of(actions))["distance_off_after_1"].sum().backward()
    assert actions.grad[0, :, 0].tolist() == pytest.approx([-0.1] * 3, abs=1e-5)
