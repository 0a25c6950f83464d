"""Statistics of a mask against a plain reading of its pixels."""

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.learning.mask_statistics import CELLS, PER_CHANNEL, STRIPS, mask_statistics
from adatracker_deploy.learning.networks import AdaTrackerConfig

SIZES = st.sampled_from((16, 32, 64))
MASKS = SIZES.flatmap(lambda size: arrays.arrays(np.bool_, (2, 3, size, size), fill=st.just(False)))


def expected(channel):
    size = len(channel)
    strip, cell = size // STRIPS, size // CELLS
    columns = [channel[:, at : at + strip].mean() for at in range(0, size, strip)]
    rows = [channel[at : at + strip].mean() for at in range(0, size, strip)]
    corners = range(0, size, cell)
    grid = [channel[y : y + cell, x : x + cell].mean() for y in corners for x in corners]
    rest = [0.0] * 5
    if channel.any():
        y, x = np.nonzero(channel)
        box = np.array([x.min(), y.min(), x.max() + 1, y.max() + 1]) / size
        rest = [1.0, *box]
    return [*np.sqrt([*columns, *rows, *grid, channel.mean()]), *rest]


@settings(max_examples=40)
@given(MASKS)
def test_they_are_those_of_the_pixels(masks):
    got = mask_statistics(torch.from_numpy(masks).float())
    wanted = [[expected(channel) for channel in mask] for mask in masks]
    assert got.shape == (2, 3 * PER_CHANNEL)
    np.testing.assert_allclose(got, np.reshape(wanted, got.shape), atol=1e-5)
    assert got.min() >= 0
    assert got.max() <= 1


def test_a_mask_of_a_size_that_the_strips_do_not_divide_is_refused():
    with pytest.raises(UsageError, match="front pooled: a mask of 40 pixels is no multiple of 16"):
        AdaTrackerConfig(size=40, front="pooled")
