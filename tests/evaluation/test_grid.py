"""The grid's episodes are the paper's bodies, equal for every policy, and kept for evaluation."""

from __future__ import annotations

from collections import Counter, defaultdict
from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.evaluation.grid import CELLS, Grid, policy_labels
from adatracker_deploy.evaluation.published import PUBLISHED
from adatracker_deploy.learning.seeds import FIRST_EVALUATION
from tests.policy import tiny

GRID = Grid(policies=("pid", "other"), condition="field", episodes=3)


def bodies(plan):
    return Counter((e.spec.embodiment.height_m, e.spec.target_speed_m_s) for e in plan)


def test_there_are_16_cells_and_the_published_rows_fill_them():
    assert len(set(CELLS)) == 16
    for row in PUBLISHED:
        assert row.cells.keys() == set(CELLS)


@pytest.mark.parametrize("row", PUBLISHED, ids=lambda row: row.name)
def test_the_published_cells_average_to_the_published_mean(row):
    for index, tolerance in enumerate((1.0, 1.0, 0.006)):
        mean = sum(cell[index] for cell in row.cells.values()) / 16
        assert mean == pytest.approx(row.mean[index], abs=tolerance)


def test_every_policy_meets_the_same_episodes():
    by_policy = defaultdict(list)
    for episode in GRID.plan():
        by_policy[episode.policy].append(replace(episode, policy=""))
    assert by_policy["pid"] == by_policy["other"]
    assert bodies(by_policy["pid"]) == {(cell.height_m, cell.target_speed_m_s): 3 for cell in CELLS}


@given(cut=st.integers(0, 96))
@settings(deadline=None)
def test_a_run_cut_short_has_as_many_of_each_give_or_take_one(cut):
    counts = Counter({(p, c.height_m, c.target_speed_m_s): 0 for p in GRID.policies for c in CELLS})
    for episode in GRID.plan()[:cut]:
        counts[episode.policy, episode.spec.embodiment.height_m, episode.spec.target_speed_m_s] += 1
    assert max(counts.values()) - min(counts.values()) <= 1


@given(seed=st.integers(0, 1000), other=st.integers(0, 1000))
@settings(deadline=None, max_examples=20)
def test_seeds_are_for_evaluation_and_no_episode_is_met_twice(seed, other):
    grids = {seed, other}
    seeds = [e.spec.seed for number in grids for e in Grid(policies=("pid",), episodes=2, seed=number).plan()]
    assert min(seeds) >= FIRST_EVALUATION
    assert len(set(seeds)) == len(grids) * 16 * 2


def test_more_episodes_keep_the_ones_before():
    assert replace(GRID, episodes=5).plan()[: len(GRID.plan())] == GRID.plan()


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"condition": "storm"}, "unknown condition 'storm'"),
        ({"scene": "moon"}, "unknown scene 'moon'"),
        ({"episodes": 0}, "episodes: 0 is out of range"),
        ({"seed": -1}, "seed: -1 is out of range"),
        ({"steps": 0}, "steps: 0 is out of range"),
        ({"policies": ("pid", "pid")}, "'pid' is named twice"),
    ],
)
def test_what_is_wrong_is_refused(change, words):
    with pytest.raises(UsageError, match=words):
        replace(GRID, **change)


def test_policies_of_one_name_are_called_as_they_were_given(tmp_path):
    first, second = tmp_path / "a", tmp_path / "b"
    for folder in (first, second):
        tiny.Parts().write(folder)
    assert policy_labels(("pid", str(first))) == {"pid": "pid", str(first): "tiny"}
    both = policy_labels((str(first), str(second)))
    assert both == {str(first): str(first), str(second): str(second)}


def test_a_network_trained_at_another_rate_is_refused(tmp_path):
    parts = tiny.Parts()
    parts.manifest = replace(parts.manifest, rate_hz=20.0)
    parts.write(tmp_path)
    with pytest.raises(UsageError, match="trained at 20 Hz; episodes here have 10 Hz"):
        policy_labels((str(tmp_path),))
