"""A sender's stamps tell whether a message is new, repeated or late, and whether the sender restarted."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from adatracker_deploy.core.stamps import RESTARTED_AFTER, StampOrder


def news(stamps):
    order = StampOrder()
    return [stamp for stamp in stamps if order.is_new(stamp)], order.restarts


@pytest.mark.parametrize(
    ("stamps", "new", "restarts"),
    [
        ([1, 2, 3], [1, 2, 3], 0),
        ([5, 5, 5, 5, 5], [5], 0),
        ([5, 4, 5, 4], [5], 0),
        ([5, 4, 5, 4, 6], [5, 6], 0),
        ([5, 4, 6, 5, 7, 6, 8, 7], [5, 6, 7, 8], 0),
        ([5, 1, 2, 3, 4, 5], [5, 4, 5], 1),
        ([5, 4, 5, 4, 5, 4, 5], [5, 5], 1),
        ([0, 0, 0], [0, 0, 0], 0),
        ([0, 0, 7, 8], [0, 0, 7, 8], 0),
        ([7, 0, 8], [7, 8], 0),
        ([7, 0, 0, 0, 0], [7, 0], 1),
    ],
)
def test_stamps(stamps, new, restarts):
    assert RESTARTED_AFTER == 3
    assert news(stamps) == (new, restarts)


@given(st.lists(st.integers(0, 20), max_size=60))
def test_a_stamp_is_only_new_above_all_new_ones_since_the_sender_began(stamps):
    order, newest, restarts = StampOrder(), 0, 0
    for stamp in stamps:
        new = order.is_new(stamp)
        if order.restarts > restarts:
            assert not new
            newest, restarts = stamp, order.restarts
        elif new:
            assert stamp > newest or stamp == newest == 0
            newest = stamp


@given(st.lists(st.integers(1, 100), min_size=1, max_size=60))
def test_a_sender_that_counts_on_is_believed_for_ever(steps):
    stamps = [sum(steps[: place + 1]) for place in range(len(steps))]
    assert news(stamps) == (stamps, 0)
