"""A class mask is drawn exactly as the policy was trained to see it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from adatracker_deploy.core.messages import MaskClass
from adatracker_deploy.policy.drawing import MaskPainter, colour_table
from adatracker_deploy.policy.manifest import MaskSpec, Palette

RANDOM = Palette(background=(0, 0, 0), target=(255, 255, 255), person="random", obstacle="random")
OFFLINE_EVT = MaskSpec(size=64, channels=3, draw_size=160, scale=1.0, palette=RANDOM)
GREY = MaskSpec(
    size=64,
    channels=1,
    draw_size=64,
    scale=0.25,
    palette=Palette(background=(0,), target=(200,), person=(120,), obstacle=(60,)),
)
masks = arrays.arrays(
    np.uint8, st.tuples(st.integers(1, 300), st.integers(1, 300)), elements=st.integers(0, 3), fill=st.just(0)
)


def painted_by_hand(spec, mask, seed):
    """Nearest by the pixel's corner, colours, bilinear by pixel centres, rounded to 8 bits."""
    # 1 / (a / b), not b / a: where the two round apart, a source pixel's edge falls as it does in OpenCV.
    missing = [max(mask.shape) - length for length in mask.shape]
    mask = np.pad(mask, [(length // 2, length - length // 2) for length in missing])
    rows, columns = (
        (np.arange(spec.draw_size) * (1 / (spec.draw_size / length))).astype(int) for length in mask.shape
    )
    drawn = colour_table(spec.palette, seed)[mask[np.ix_(rows, columns)]].astype(float)
    centre = np.clip((np.arange(spec.size) + 0.5) * spec.draw_size / spec.size - 0.5, 0, spec.draw_size - 1)
    low = np.minimum(centre.astype(int), spec.draw_size - 2)
    part = (centre - low)[:, None, None]
    drawn = drawn[low] * (1 - part) + drawn[low + 1] * part
    drawn = drawn[:, low] * (1 - part[:, 0]) + drawn[:, low + 1] * part[:, 0]
    return np.round(drawn).transpose(2, 0, 1) * spec.scale


@pytest.mark.parametrize("spec", [OFFLINE_EVT, GREY], ids=["offline_evt", "grey"])
@given(mask=masks, seed=st.integers(0, 99))
def test_the_picture_is_nearest_to_draw_size_then_coloured_then_bilinear(spec, mask, seed):
    painted = MaskPainter(spec, seed).paint(mask)
    assert painted.shape == (spec.channels, spec.size, spec.size)
    assert painted.dtype == np.float32
    # OpenCV interpolates in fixed point of 11 bits: within one level of 255.
    np.testing.assert_allclose(painted, painted_by_hand(spec, mask, seed), atol=1.0 * spec.scale)


def test_at_its_own_size_every_class_has_its_colour_times_the_scale():
    mask = np.zeros((64, 64), np.uint8)
    mask[:16], mask[16:32], mask[32:48] = MaskClass.TARGET, MaskClass.PERSON, MaskClass.OBSTACLE
    painted = MaskPainter(GREY).paint(mask)
    assert painted[0, ::16, 0].tolist() == [50.0, 30.0, 15.0, 0.0]


@given(st.integers(0, 2**32))
def test_persons_and_obstacles_share_a_colour_that_is_neither_black_nor_white(seed):
    background, target, person, obstacle = colour_table(RANDOM, seed).tolist()
    assert person == obstacle
    assert person not in (background, target, [0, 0, 0], [255, 255, 255])


def test_a_random_grey_never_meets_the_targets():
    palette = replace(GREY.palette, person="random")
    tables = [colour_table(palette, seed)[:, 0].tolist() for seed in range(2000)]
    assert all(table[MaskClass.PERSON] not in (0, 200, 255) for table in tables)
    assert all(table[MaskClass.OBSTACLE] == 60 for table in tables)


def test_the_colour_belongs_to_the_episodes_seed():
    mask = np.full((160, 160), MaskClass.PERSON, np.uint8)
    painter = MaskPainter(OFFLINE_EVT)
    colours = []
    for seed in (1, 2, 1):
        painter.reset(seed)
        colours.append(painter.paint(mask)[:, 0, 0].tolist())
    assert colours[0] == colours[2] != colours[1]


def test_painting_leaves_nothing_of_the_picture_before():
    painter = MaskPainter(OFFLINE_EVT)
    painter.paint(np.full((120, 160), MaskClass.TARGET, np.uint8))
    assert not painter.paint(np.zeros((120, 160), np.uint8)).any()
