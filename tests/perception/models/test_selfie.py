"""The mask head cuts people out where they are, by a network that calls everything bright a person."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from adatracker_deploy.core.errors import PlatformError, UsageError
from adatracker_deploy.perception.models.model_file import read_model_file
from adatracker_deploy.perception.models.selfie import SelfieMasks
from tests.perception.models import graphs

BRIGHT = """
selfie (float[1,256,256,3] image) => (float[1,256,256,1] mask) {
    grey = ReduceMean<axes = [3], keepdims = 1>(image)
    lit = Greater(grey, level)
    mask = Cast<to = 1>(lit)
}"""
SIZE = 40


def model(path, text=BRIGHT, level=0.5):
    graphs.save(path, text, {"level": np.float32(level)})
    return SelfieMasks(read_model_file(path))


@pytest.fixture(scope="module")
def bright(tmp_path_factory):
    return model(tmp_path_factory.mktemp("selfie") / "selfie.onnx")


def person(shape, *boxes):
    picture = np.full((*shape, 3), 20, np.uint8)
    for left, top, right, bottom in boxes:
        picture[top:bottom, left:right] = 240
    return picture


def part(box, shape, size=SIZE):
    """The share of each cell that the box covers."""

    def share(low, high, length):
        edges = np.arange(size + 1) * length / size
        return np.clip(np.minimum(edges[1:], high) - np.maximum(edges[:-1], low), 0, None) / (length / size)

    left, top, right, bottom = box
    return np.outer(share(top, bottom, shape[0]), share(left, right, shape[1]))


def within_a_cell(mask, box, shape):
    """See that no edge of the mask is a cell or more from where it must be."""
    size = mask.shape[0]
    wanted = np.array(box) / np.tile([shape[1], shape[0]], 2) * size
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    assert rows.size
    got = np.array([columns[0], rows[0], columns[-1] + 1, rows[-1] + 1])
    assert np.abs(got - wanted).max() <= 1, (got, wanted)
    assert mask[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1].all()


SHAPES = [(240, 240), (240, 400), (400, 240), (480, 640), (96, 160)]


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize(
    "share",
    [
        (0.3, 0.2, 0.5, 0.8),
        (0.0, 0.2, 0.2, 0.9),
        (0.8, 0.1, 1.0, 0.7),
        (0.4, 0.0, 0.6, 1.0),
        (0.0, 0.0, 1.0, 1.0),
        (0.6, 0.7, 0.7, 1.0),
        (0.1, 0.4, 0.9, 0.6),
    ],
    ids=["inside", "left edge", "right edge", "full height", "everywhere", "ground", "lying"],
)
def test_the_mask_lies_where_the_person_is(bright, shape, share):
    box = tuple(round(part * side) for part, side in zip(share, (shape[1], shape[0]) * 2, strict=True))
    (mask,) = bright(person(shape, box), np.array([box], np.float32), SIZE)
    within_a_cell(mask, box, shape)


@settings(max_examples=40)
@given(
    st.sampled_from(SHAPES),
    st.tuples(st.floats(0, 0.8), st.floats(0, 0.8), st.floats(0.1, 1), st.floats(0.1, 1)),
    st.sampled_from([40, 64, 160]),
)
def test_wherever_the_person_is_the_mask_is_within_a_cell(bright, shape, place, size):
    rows, columns = shape
    left, top = round(place[0] * columns), round(place[1] * rows)
    box = left, top, min(columns, left + round(place[2] * columns)), min(rows, top + round(place[3] * rows))
    (mask,) = bright(person(shape, box), np.array([box], np.float32), size)
    assert mask.shape == (size, size)
    wanted = part(box, shape, size)
    inner, outer = wanted == 1, part((box[0] - 4, box[1] - 4, box[2] + 4, box[3] + 4), shape, size) > 0
    assert (mask | ~_eroded(inner)).all()
    assert not (mask & ~_grown(outer)).any()


def _grown(cells):
    padded = np.pad(cells, 1)
    rows, columns = cells.shape
    return np.any([padded[y : y + rows, x : x + columns] for y in range(3) for x in range(3)], axis=0)


def _eroded(cells):
    """Less a cell all around, also where they end at the picture's edge."""
    return ~_grown(np.pad(~cells, 1, constant_values=True))[1:-1, 1:-1]


def test_what_is_outside_the_box_is_not_the_person(bright):
    shape, a, b = (240, 400), (50, 60, 110, 180), (130, 60, 190, 180)
    masks = bright(person(shape, a, b), np.array([a, b], np.float32), SIZE)
    within_a_cell(masks[0], a, shape)
    within_a_cell(masks[1], b, shape)


def test_what_is_dark_in_the_box_is_not_the_person(bright):
    shape, upper = (240, 400), (100, 40, 160, 120)
    (mask,) = bright(person(shape, upper), np.array([(90, 30, 170, 220)], np.float32), SIZE)
    within_a_cell(mask, upper, shape)


def test_nobody_has_no_mask(bright):
    assert bright(person((240, 400)), np.empty((0, 4), np.float32), SIZE).shape == (0, SIZE, SIZE)


def test_the_picture_comes_as_red_green_blue_from_0_to_1(tmp_path):
    text = BRIGHT.replace(
        "grey = ReduceMean<axes = [3], keepdims = 1>(image)", "grey = Slice(image, b, e, axis)"
    )
    for colour, seen in (((255, 0, 0), True), ((0, 0, 255), False)):
        graphs.save(
            tmp_path / "s.onnx",
            text,
            {"level": np.float32(0.97), "b": np.array([0]), "e": np.array([1]), "axis": np.array([3])},
        )
        picture = np.full((100, 100, 3), colour, np.uint8)
        (mask,) = SelfieMasks(read_model_file(tmp_path / "s.onnx"))(
            picture, np.array([(20, 20, 80, 80)], np.float32), SIZE
        )
        assert mask.any() == seen


@pytest.mark.parametrize(
    ("old", "new", "reason"),
    [
        ("image)", "picture)", "has no input 'image'"),
        (" mask)", " alpha)", "has no output 'mask'"),
        ("256,256,3", "128,128,3", r"expected image \[1, 256, 256, 3\]"),
    ],
)
def test_another_network_is_refused(tmp_path, old, new, reason):
    text = BRIGHT.replace(old, new)
    if "alpha" in new:
        text = text.replace("mask = Cast", "alpha = Cast")
    if "128" in new:
        text = text.replace("256,256,1", "128,128,1")
    if "picture" in new:
        text = text.replace("(image)", "(picture)")
    with pytest.raises(UsageError, match=reason):
        model(tmp_path / "s.onnx", text)


def test_numbers_that_are_none_end_it_with_a_sentence(tmp_path):
    text = BRIGHT.replace("mask = Cast<to = 1>(lit)", "flat = Cast<to = 1>(lit)  mask = Div(flat, level)")
    with pytest.raises(PlatformError, match="gave mask with numbers that are not finite"):
        model(tmp_path / "s.onnx", text, level=0.0)(
            person((100, 100)), np.array([(20, 20, 80, 80)], np.float32), SIZE
        )
