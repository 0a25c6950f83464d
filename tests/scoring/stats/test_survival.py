"""The survival curve against the literature's, and what must hold for any."""

from __future__ import annotations

import itertools

import pytest
from hypothesis import given
from hypothesis import strategies as st

from adatracker_deploy.scoring.stats.survival import kaplan_meier, median_duration

REMISSION = "6 6 6 6+ 7 9+ 10 10+ 11+ 13 16 17+ 19+ 20+ 22 23 25+ 32+ 32+ 34+ 35+"
"""Weeks in remission on 6-mercaptopurine, + censored: E. J. Freireich et al., Blood 21 (1963) 699-716."""
ends = st.lists(st.tuples(st.integers(0, 20), st.booleans()), min_size=1, max_size=12)


def test_the_curve_is_the_textbooks():
    weeks = [float(text.rstrip("+")) for text in REMISSION.split()]
    falls = kaplan_meier(weeks, [not text.endswith("+") for text in REMISSION.split()])
    assert [(fall.at, fall.at_risk, fall.failed) for fall in falls] == [
        (6, 21, 3), (7, 17, 1), (10, 15, 1), (13, 12, 1), (16, 11, 1), (22, 7, 1), (23, 6, 1),
    ]  # fmt: skip
    survivals = [fall.survival for fall in falls]
    assert survivals == pytest.approx([0.857, 0.807, 0.753, 0.690, 0.627, 0.538, 0.448], abs=6e-4)
    assert median_duration(falls) == 23


@given(ends)
def test_without_censoring_it_is_the_share_that_lasted_longer(trials):
    durations = [duration for duration, _ in trials]
    for fall in kaplan_meier(durations, [True] * len(durations)):
        assert fall.survival == pytest.approx(sum(d > fall.at for d in durations) / len(durations))


@given(ends)
def test_it_falls_from_one_and_never_below_nothing(trials):
    falls = kaplan_meier(*zip(*trials, strict=True))
    survivals = [1.0, *(fall.survival for fall in falls)]
    assert all(0 <= after < before for before, after in itertools.pairwise(survivals))
    assert sum(fall.failed for fall in falls) == sum(failed for _, failed in trials)


def test_trials_that_all_reached_the_horizon_never_fall():
    assert kaplan_meier([600] * 5, [False] * 5) == ()
    assert median_duration(()) is None


def test_every_trial_needs_its_end():
    with pytest.raises(ValueError, match="argument 2"):
        kaplan_meier([1, 2], [True])
