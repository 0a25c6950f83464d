"""DAgger's data: the policy drives, the expert labels, memory is reset where episodes begin."""

from __future__ import annotations

import numpy as np
import pytest

from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.learning.data.dataset import Dataset
from adatracker_deploy.learning.data.shard import unpack_masks
from adatracker_deploy.learning.data.visit import Company, collect_visited, visit
from tests.learning.data import tiny


class Witness:
    """Turns slowly on the spot, and remembers what it was shown."""

    def __init__(self) -> None:
        self.masks, self.last, self.resets = [], [], []

    def __call__(self, masks, last_actions, resets):
        self.masks.append(masks.copy())
        self.last.append(last_actions.copy())
        self.resets.append(resets.copy())
        return np.tile(np.float32([0.0, 0.1]), (len(masks), 1))


def test_the_policy_drives_and_the_expert_labels():
    records = list(visit(tiny.recipe(), Witness(), steps=150, seed=0, company=Company(), envs=3))
    assert sum(header.steps for header, _ in records) == 150
    for _, steps in records:
        assert np.allclose(steps.actions, [0.0, 0.1])
        assert not np.allclose(steps.experts, [0.0, 0.1])


def test_with_everything_mixed_in_the_expert_drives_in_stretches():
    (_, steps), *_ = visit(
        tiny.recipe(episode_steps=400), Witness(), steps=400, seed=0, company=Company(mix=0.5), envs=1
    )
    by_expert = (steps.actions == steps.experts).all(axis=1)
    changes = np.abs(np.diff(by_expert.astype(int))).sum()
    assert 0.15 < by_expert.mean() < 0.85
    assert changes < 0.15 * len(steps)


def test_a_policy_sees_every_mask_that_is_stored_and_is_told_where_episodes_begin():
    witness = Witness()
    records = list(visit(tiny.recipe(), witness, steps=100, seed=4, company=Company(mix=0.5), envs=1))
    stored = np.concatenate([unpack_masks(steps.masks) for _, steps in records])
    executed = np.concatenate([steps.actions for _, steps in records])
    starts = np.cumsum([0] + [header.steps for header, _ in records[:-1]])
    assert np.array_equal(np.concatenate(witness.masks), stored)
    assert np.flatnonzero(np.concatenate(witness.resets)).tolist() == starts.tolist()
    last = np.concatenate(witness.last)
    assert not last[starts].any()
    inside = np.setdiff1d(np.arange(1, 100), starts)
    assert np.array_equal(last[inside], executed[inside - 1])


def test_visited_states_are_shards_like_any_other_and_rounds_do_not_mix(tmp_path):
    collect_visited(tiny.recipe(), Witness(), steps=130, out_dir=tmp_path / "round", seed=1, envs=4)
    data = Dataset.open([tmp_path / "round"])
    assert len(data) == 130
    with pytest.raises(UsageError, match="holds shards already"):
        collect_visited(tiny.recipe(), Witness(), steps=10, out_dir=tmp_path / "round", seed=2)


def test_rounds_with_other_seeds_visit_other_episodes():
    drawn = [
        {header.spec.seed for header, _ in visit(tiny.recipe(), Witness(), steps=90, seed=seed, envs=2)}
        for seed in (1, 2)
    ]
    assert not drawn[0] & drawn[1]


def test_a_policy_is_perturbed_as_an_episodes_level_says_and_labelled_where_it_gets_to():
    records = list(visit(tiny.recipe(), Witness(), steps=300, seed=0, company=Company(levels=(0.0, 1.0))))
    moved = [not np.allclose(steps.actions, [0.0, 0.1]) for _, steps in records]
    assert any(moved)
    assert not all(moved)
    assert all((np.abs(steps.actions) <= 1).all() for _, steps in records)
