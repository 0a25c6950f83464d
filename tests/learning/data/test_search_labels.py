"""Where the target is gone, a clone is to turn to the side where it last was: that it can know."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from adatracker_deploy.learning.data.search_labels import PATIENCE, search_labels, target_centres
from adatracker_deploy.learning.data.shard import pack_masks


def masks_of(columns) -> np.ndarray:
    """Masks with a target one pixel wide in these columns; none where it is None."""
    masks = np.zeros((len(columns), 64, 64), np.uint8)
    masks[:, 5, 7] = 2  # somebody else
    for mask, column in zip(masks, columns, strict=True):
        if column is not None:
            mask[20:40, column] = 1
    return pack_masks(masks)


def labels(columns, turns, starts=(0,)):
    first = np.repeat(starts, np.diff([*starts, len(columns)]))
    experts = np.stack([np.linspace(-1, 1, len(turns)), turns], axis=1).astype(np.float32)
    found = search_labels(masks_of(columns), experts, first)
    assert np.array_equal(found[:, 0], experts[:, 0])  # forward is the expert's
    return found[:, 1].tolist()


def test_the_centre_is_a_column_from_the_images_middle():
    assert target_centres(masks_of([0, 63, None, 40])).tolist() == pytest.approx(
        [-31.5, 31.5, np.nan, 8.5], nan_ok=True
    )


def test_it_turns_to_the_side_where_the_target_was_last_seen_all_the_time():
    gone = [None] * 6
    turns = [0.1, -1, -1, -1, 1, 1, -1]
    assert labels([10, *gone], turns) == pytest.approx([0.1, -1, -1, 1, 1, 1, 1])  # out on the left
    assert labels([50, *gone], turns) == pytest.approx([0.1, -1, -1, -1, -1, -1, -1])  # on the right


def test_an_expert_that_turns_slower_looks_at_a_hidden_target_and_is_cloned():
    assert labels([10, None, None, None, None], [0.0, 0.0, 0.0, -0.3, -0.97]) == pytest.approx(
        [0.0, 0.0, 0.0, -0.3, -0.97]
    )


def test_an_episode_knows_nothing_of_the_one_before():
    columns = [60, 60, None, None, None, None]
    assert labels(columns, [-1.0] * 6, starts=(0, 2)) == [
        -1,
        -1,
        -1,
        -1,
        1,
        1,
    ]  # to the left, for want of a side


@given(
    st.lists(
        st.tuples(st.none() | st.integers(0, 63), st.sampled_from([-1.0, -0.5, 0.0, 0.5, 1.0])), min_size=1
    )
)
def test_only_full_turns_are_replaced_and_only_where_the_target_is_gone(steps):
    columns, turns = zip(*steps, strict=True)
    found = labels(columns, turns)
    for place, (label, turn) in enumerate(zip(found, turns, strict=True)):
        just_seen = any(column is not None for column in columns[max(0, place - PATIENCE + 1) : place + 1])
        if just_seen or abs(turn) < 1:
            assert label == turn
        else:
            assert abs(label) == 1
