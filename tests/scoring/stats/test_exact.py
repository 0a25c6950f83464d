"""Exact tests against published values, against counting by hand, and against what they promise."""

from __future__ import annotations

import itertools
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from adatracker_deploy.scoring.stats import exact
from adatracker_deploy.scoring.stats.exact import fisher, permutation, sign_flip

DARWINS_MAIZE = (49, -67, 8, 16, 6, 23, 28, 41, 14, 29, 56, 24, 75, 60, -48)
few = st.lists(st.integers(-50, 50), min_size=1, max_size=5)


@pytest.mark.parametrize(
    ("ours", "theirs", "p"),
    [
        ((3, 4), (1, 4), Fraction(34, 70)),  # the lady tasting tea: Fisher 1935, section 11
        ((10, 13), (2, 17), 0.0005367),  # convictions of twins: Fisher 1970, as R's fisher.test prints it
        ((5, 5), (2, 5), Fraction(1, 6)),
        ((5, 5), (0, 5), Fraction(2, 252)),
        ((3, 3), (4, 4), 1),
    ],
)
def test_fishers_test_is_the_literatures(ours, theirs, p):
    assert fisher(*ours, *theirs).p == pytest.approx(float(p), rel=1e-4)
    assert fisher(*theirs, *ours).p == fisher(*ours, *theirs).p


def test_swapping_within_pairs_is_fishers_count_for_darwins_maize():
    """Fisher 1935, section 21: 1,726 of the 32,768 ways give a total of 314 or more, of either sign."""
    assert sum(DARWINS_MAIZE) == 314
    assert sign_flip(DARWINS_MAIZE).p == 1726 / 32768


@given(few, few)
def test_dealing_out_is_what_counting_with_fractions_finds(ours, theirs):
    values = [Fraction(value) for value in (*ours, *theirs)]
    mean = sum(values) / len(values)

    def far(indices):
        return abs(sum(values[index] - mean for index in indices))

    ways = [far(indices) for indices in itertools.combinations(range(len(values)), len(ours))]
    as_far = sum(way >= far(range(len(ours))) for way in ways)
    assert permutation(ours, theirs).p == pytest.approx(as_far / len(ways))


@given(few)
def test_swapping_is_what_counting_finds(differences):
    sums = [sum(sign * value for sign, value in zip(signs, differences, strict=True))
            for signs in itertools.product((1, -1), repeat=len(differences))]  # fmt: skip
    as_far = sum(abs(total) >= abs(sum(differences)) for total in sums)
    assert sign_flip(differences).p == as_far / len(sums)


def test_five_trials_a_side_have_a_floor_that_no_result_can_break():
    """The largest differences there can be."""
    assert permutation([1.0, 0.9, 0.8, 0.95, 0.85], [0.1, 0.2, 0.3, 0.15, 0.25]).p == 2 / 252
    assert permutation([1.0, 0.9, 0.8, 0.95, 0.85], [0.1, 0.2, 0.3, 0.15, 0.25]).least == 2 / 252
    assert sign_flip([0.9, 0.7, 0.5, 0.8, 0.6]).p == sign_flip([0.9, 0.7, 0.5, 0.8, 0.6]).least == 0.0625
    assert not sign_flip([0.9, 0.7, 0.5, 0.8, 0.6]).separates
    assert fisher(4, 4, 0, 3).least == fisher(4, 4, 0, 3).p == 1 / 35


@given(few.filter(lambda values: len(values) > 1), st.floats(-1e3, 1e3), st.floats(0.1, 10))
def test_units_and_offsets_change_nothing(values, offset, scale):
    theirs = [value**2 % 17 for value in values]
    moved = permutation([scale * v + offset for v in values], [scale * v + offset for v in theirs])
    assert moved.p == permutation(values, theirs).p


def test_equal_values_differ_in_no_way():
    assert permutation([0.1] * 3, [0.1] * 5).p == 1
    assert sign_flip([0.0] * 6).p == 1


def test_more_ways_than_can_be_counted_are_sampled_and_agree(monkeypatch):
    rng = np.random.default_rng(5)
    ours, theirs = rng.normal(0.5, 1, 9).tolist(), rng.normal(0, 1, 9).tolist()
    pairs = rng.normal(0.4, 1, 12).tolist()
    counted = permutation(ours, theirs), sign_flip(pairs)
    monkeypatch.setattr(exact, "MAX_WAYS", 10)
    sampled = permutation(ours, theirs), sign_flip(pairs)
    for whole, part in zip(counted, sampled, strict=True):
        assert whole.exact
        assert not part.exact
        assert part.p == pytest.approx(whole.p, abs=4 * (whole.p / exact.SAMPLED_WAYS) ** 0.5)
    monkeypatch.setattr(exact, "SAMPLED_WAYS", 200)
    never_drawn = permutation([1.0] * 20, [0.0] * 20)
    assert never_drawn.p == 1 / 201, "a sample can never say impossible"


def test_a_test_at_five_percent_is_wrong_in_at_most_five_of_a_hundred(measured):
    rng = np.random.default_rng(11)
    rounds = 2000
    unpaired = sum(permutation(*rng.exponential(1, (2, 5)).tolist()).separates for _ in range(rounds))
    paired = sum(sign_flip(rng.normal(0, 1, 8).tolist()).separates for _ in range(rounds))
    shares = sum(fisher(*(int(v) for v in np.insert(rng.binomial(8, 0.6, 2), [1, 2], 8))).separates
                 for _ in range(rounds))  # fmt: skip
    measured(
        f"tests at 5 % where nothing differs: permutation {unpaired / rounds:.1%} of 5 against 5, "
        f"sign flips {paired / rounds:.1%} of 8 pairs, Fisher {shares / rounds:.1%} of 8 against 8"
    )
    for wrong in (unpaired, paired, shares):
        assert wrong / rounds < 0.05 + 3 * (0.05 * 0.95 / rounds) ** 0.5
    assert min(unpaired, paired) / rounds > 0.03, "a test that never speaks is no test"


@pytest.mark.parametrize("wrong", [(0, 0, 1, 2), (3, 2, 1, 2), (-1, 4, 1, 2), (1, 2, 0, 0)])
def test_what_are_no_shares_is_refused(wrong):
    with pytest.raises(ValueError, match="no shares"):
        fisher(*wrong)


def test_nothing_cannot_be_compared():
    for call in (lambda: permutation([], [1.0]), lambda: permutation([1.0], []), lambda: sign_flip([])):
        with pytest.raises(ValueError, match="no values"):
            call()
