"""The product-limit estimate, against published figures and by pencil."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from adatracker_deploy.report.survival import Life, survival_curve

lives = st.lists(st.builds(Life, st.integers(0, 50), st.booleans()), max_size=30)


def test_it_equals_the_published_estimate_for_the_patients_with_6_mercaptopurine():
    """Weeks of remission of E. J. Freireich et al., 1963; estimates as in every textbook since Cox, 1972."""
    failed = [6, 6, 6, 7, 10, 13, 16, 22, 23]
    censored = [6, 9, 10, 11, 17, 19, 20, 25, 32, 32, 34, 35]
    patients = [Life(week, True) for week in failed] + [Life(week, False) for week in censored]
    assert [(week, round(share, 3)) for week, share in survival_curve(patients)] == [
        (0, 1.0), (6, 0.857), (7, 0.807), (10, 0.753), (13, 0.690), (16, 0.627), (22, 0.538), (23, 0.448),
    ]  # fmt: skip


@given(lives)
def test_it_starts_at_one_and_only_falls(trials):
    curve = survival_curve(trials)
    assert curve[0] == (0, 1.0) or trials
    shares = [share for _, share in curve]
    assert shares == sorted(shares, reverse=True)
    assert 0 <= shares[-1] <= shares[0] == 1.0


@given(st.lists(st.integers(0, 50), min_size=1, max_size=30))
def test_where_every_trial_failed_it_is_the_share_of_longer_ones(lengths):
    for steps, share in survival_curve([Life(length, True) for length in lengths])[1:]:
        assert share == pytest.approx(sum(length > steps for length in lengths) / len(lengths))


def test_where_every_trial_was_completed_it_stays_at_one():
    assert survival_curve([Life(100, False)] * 5) == [(0, 1.0)]
