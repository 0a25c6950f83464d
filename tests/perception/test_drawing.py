"""In the class mask the nearer of two things covers the farther, at any resolution of their masks."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from adatracker_deploy.perception.drawing import MASK_SIZE, class_mask, ellipses


def block(left, top, right, bottom, shape=(MASK_SIZE, MASK_SIZE)):
    mask = np.zeros(shape, bool)
    mask[top:bottom, left:right] = True
    return mask


def test_nothing_is_background():
    drawn = class_mask([], [], np.empty(0))
    assert (drawn.shape, drawn.dtype, drawn.max()) == ((160, 160), np.uint8, 0)


@pytest.mark.parametrize("order", [(0, 1), (1, 0)])
def test_the_lower_is_the_nearer_and_covers_the_other_in_whatever_order_they_come(order):
    masks = [block(20, 20, 80, 120), block(60, 40, 120, 140)]
    values, bottoms = [1, 2], np.array([120.0, 140.0])
    drawn = class_mask([masks[i] for i in order], [values[i] for i in order], bottoms[list(order)])
    np.testing.assert_array_equal(drawn == 2, masks[1])
    np.testing.assert_array_equal(drawn == 1, masks[0] & ~masks[1])


@pytest.mark.parametrize("shape", [(40, 80), (320, 640), (480, 160), (80, 320), (720, 1280)])
def test_a_mask_of_another_resolution_covers_the_same_part_of_the_picture(shape):
    rows, columns = shape
    mask = block(columns // 4, rows // 2, columns // 2, 3 * rows // 4, shape)
    expected = block(40, 80, 80, 120)
    np.testing.assert_array_equal(class_mask([mask], [3], np.zeros(1), 160) == 3, expected)


def test_masks_of_several_resolutions_go_into_one():
    masks = [block(0, 0, 40, 80, (80, 80)), block(160, 0, 320, 320, (320, 320))]
    drawn = class_mask(masks, [1, 3], np.zeros(2))
    assert (drawn[:, :80] == 1).all()
    assert (drawn[:, 80:] == 3).all()


def test_a_thin_thing_in_a_large_mask_is_not_blown_up():
    mask = block(640, 0, 648, 720, (720, 1280))  # one cell wide
    assert (class_mask([mask], [1], np.zeros(1)) == 1).sum() == 160


def test_an_ellipse_fills_its_box_and_no_more():
    (mask,) = ellipses(np.array([(80, 60, 240, 180)], np.float32), 320, 240)
    columns, rows = np.flatnonzero(mask.any(axis=0)), np.flatnonzero(mask.any(axis=1))
    assert (columns[0], columns[-1]) == (pytest.approx(40, abs=1), pytest.approx(120, abs=1))
    assert (rows[0], rows[-1]) == (pytest.approx(40, abs=1), pytest.approx(120, abs=1))
    assert mask.sum() == pytest.approx(np.pi / 4 * 80 * 80, rel=0.05)
    assert not mask[42, 42]


box = st.tuples(st.floats(0, 639), st.floats(0, 359), st.floats(1, 640), st.floats(1, 360))


@given(st.lists(box, max_size=4))
def test_every_box_in_the_picture_has_an_ellipse_within_a_cell_of_it(found):
    boxes = np.array([(x, y, min(640, x + w), min(360, y + h)) for x, y, w, h in found], np.float32)
    masks = ellipses(boxes.reshape(-1, 4), 640, 360)
    assert masks.shape == (len(boxes), 160, 160)
    for mask, (left, top, right, bottom) in zip(masks, boxes, strict=True):
        rows, columns = np.nonzero(mask)
        assert rows.size
        assert left / 4 - 2 <= columns.min() <= columns.max() <= right / 4 + 2
        assert top / 2.25 - 2 <= rows.min() <= rows.max() <= bottom / 2.25 + 2
