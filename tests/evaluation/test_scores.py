"""Scores are the numbers they are said to be, and differences are paired."""

from __future__ import annotations

import statistics

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from adatracker_deploy.evaluation.grid import CELLS, Grid
from adatracker_deploy.evaluation.play import Played
from adatracker_deploy.evaluation.scores import PolicyScore, difference, differences

EPISODES = 3
PLAN = Grid(policies=("pid",), episodes=EPISODES).plan()


def score(name, outcome):
    """A policy whose episode number `index` of the plan came to `outcome(index)`."""
    return PolicyScore.of(name, [(episode, outcome(index)) for index, episode in enumerate(PLAN)])


def noisy(seed, ar):
    values = np.random.default_rng(seed).normal(ar, 50.0, len(PLAN)).tolist()
    return lambda index: Played(values[index], 500, True)


def test_cells_and_the_mean_are_averages_over_episodes():
    policy = score("p", lambda index: Played(float(index % 16), 400 + index // 16, index < 24))
    assert [cell.cell for cell in policy.cells] == list(CELLS)
    assert [cell.metrics.ar.value for cell in policy.cells] == list(range(16))
    assert policy.metrics.ar.value == 7.5
    assert policy.metrics.el.value == 401
    assert policy.metrics.sr.value == 0.5
    assert policy.cells[0].metrics.sr.value == pytest.approx(2 / 3)
    assert policy.cells[15].metrics.sr.value == pytest.approx(1 / 3)


def test_alike_episodes_of_a_cell_do_not_pass_for_many():
    """Sixteen bodies say as much as sixteen numbers, however often each is met."""
    alike = score("p", lambda index: Played(float(index % 16), 500, True)).metrics.ar
    spread = statistics.stdev(range(16)) / 4
    assert alike.high - alike.value == pytest.approx(2.131 * spread, rel=1e-3)


def test_success_everywhere_is_not_taken_for_certain():
    share = score("p", lambda _: Played(0.0, 500, True)).metrics.sr
    assert share.value == share.high == 1.0
    assert 0.9 < share.low < 0.95


def test_pairing_finds_a_small_difference_that_noise_would_hide():
    base = noisy(0, 300.0)
    better = score("better", lambda index: Played(base(index).ar + 5.0, 500, True))
    found = difference(better, score("base", base))
    assert found.episodes == len(PLAN)
    assert found.metrics.ar.value == pytest.approx(5.0)
    assert found.metrics.ar.excludes_zero
    assert not found.metrics.el.excludes_zero


def test_equal_policies_differ_in_1_of_20_comparisons():
    told = [
        difference(score("a", noisy(seed, 0.0)), score("b", noisy(seed + 1000, 0.0))).metrics.ar.excludes_zero
        for seed in range(400)
    ]
    assert statistics.fmean(told) == pytest.approx(0.05, abs=0.03)


@settings(deadline=None, max_examples=30)
@given(ours=st.integers(0, 99), theirs=st.integers(0, 99))
def test_a_difference_turned_around_has_the_other_sign(ours, theirs):
    a, b = score("a", noisy(ours, 10.0)), score("b", noisy(theirs, 0.0))
    there, back = difference(a, b).metrics.ar, difference(b, a).metrics.ar
    assert (there.value, there.low) == (pytest.approx(-back.value), pytest.approx(-back.high))


def test_only_episodes_that_both_played_are_compared():
    whole = score("whole", lambda _: Played(100.0, 500, True))
    part = PolicyScore.of("part", [(episode, Played(90.0, 500, True)) for episode in PLAN[:5]])
    found = difference(whole, part)
    assert (found.episodes, found.metrics.ar.value) == (5, 10.0)
    other_seed = Grid(policies=("pid",), episodes=1, seed=9).plan()
    elsewhere = PolicyScore.of("elsewhere", [(episode, Played(0.0, 1, False)) for episode in other_seed])
    assert difference(whole, elsewhere) is None


def test_every_pair_is_compared_once():
    three = [score(name, noisy(number, 0.0)) for number, name in enumerate("abc")]
    assert [(each.policy, each.baseline) for each in differences(three)] == [
        ("a", "b"),
        ("a", "c"),
        ("b", "c"),
    ]
