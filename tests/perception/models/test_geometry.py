"""Boxes and maps survive the way into a network's input and back; non-maximum suppression keeps the best."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from adatracker_deploy.perception.boxes import clipped, from_centres, non_maximum_suppression, overlap
from adatracker_deploy.perception.models.image_input import in_boxes
from adatracker_deploy.perception.models.picture import Preparation, fit, prepare

SIZES = st.tuples(st.integers(16, 1200), st.integers(16, 1200))
INPUTS = st.tuples(st.integers(2, 20), st.integers(2, 20)).map(lambda pair: (pair[0] * 32, pair[1] * 32))
RESIZES = st.sampled_from(["stretch", "letterbox", "letterbox_corner"])


@st.composite
def boxes_of(draw, side=1000):
    n = draw(st.integers(1, 20))
    edges = draw(arrays(np.float32, (n, 4), elements=st.floats(0, side, width=32)))
    low, high = np.minimum(edges[:, :2], edges[:, 2:]), np.maximum(edges[:, :2], edges[:, 2:])
    return np.concatenate([low, high], axis=1)


@given(SIZES, INPUTS, RESIZES, boxes_of(side=1))
def test_a_box_that_is_laid_in_comes_back_within_a_pixel(size, model, resize, shares):
    boxes = shares * np.array([size[1], size[0], size[1], size[0]], np.float32)
    place = fit(size, model, resize)
    laid = place.boxes_in(boxes)
    assert laid.min() >= -1e-2
    assert (laid <= np.array([model[1], model[0], model[1], model[0]]) + 1e-2).all()
    np.testing.assert_allclose(place.boxes_back(laid), boxes, atol=1)


@settings(max_examples=50)
@given(boxes_of(), st.floats(0.05, 0.95), st.data())
def test_no_two_boxes_of_one_class_stay_that_overlap_by_more(boxes, iou, data):
    n = len(boxes)
    scores = data.draw(arrays(np.float32, n, elements=st.floats(0, 1, width=32)))
    classes = data.draw(arrays(np.intp, n, elements=st.integers(0, 2)))
    kept = non_maximum_suppression(boxes, scores, classes, iou)
    assert (np.diff(scores[kept]) <= 0).all()
    shared = overlap(boxes[kept], boxes[kept])
    same = classes[kept][:, None] == classes[kept][None, :]
    assert not (np.triu(same, 1) & (shared > iou)).any()
    for gone in set(range(n)) - set(kept.tolist()):  # a better box of its class is kept
        rivals = [at for at in kept if classes[at] == classes[gone] and scores[at] >= scores[gone]]
        assert overlap(boxes[[gone]], boxes[rivals]).max() > iou


def test_overlap_by_pencil():
    a = np.array([[0, 0, 10, 10]], np.float32)
    b = np.array([[5, 0, 15, 10], [20, 20, 30, 30], [0, 0, 10, 10], [3, 3, 3, 3]], np.float32)
    np.testing.assert_allclose(overlap(a, b), [[50 / 150, 0, 1, 0]], atol=1e-6)


def test_boxes_are_clipped_and_what_holds_nothing_is_dropped():
    boxes = from_centres(np.array([[5, 5, 20, 4], [50, 5, 4, 4], [5, 5, 0.5, 9]], np.float32))
    inside, whole = clipped(boxes, 20, 40)
    assert whole.tolist() == [0]
    assert inside[0].tolist() == [0, 3, 15, 7]


def test_a_picture_is_prepared_as_declared():
    picture = np.full((2, 4, 3), (10, 20, 30), np.uint8)
    how = Preparation(resize="letterbox", colour="bgr", scale=0.1, mean=(1, 0, 0), std=(2, 1, 1))
    made = prepare(picture, fit((2, 4), (4, 4), "letterbox"), how)
    assert made.shape == (1, 3, 4, 4)
    np.testing.assert_allclose(made[0, :, 1, 0], [1, 2, 1], rtol=1e-6)  # (3 - 1) / 2, 2, 1
    np.testing.assert_allclose(made[0, :, 0, 0], [5.2, 11.4, 11.4], rtol=1e-6)  # the grey padding above
    assert prepare(picture, fit((2, 4), (4, 4), "stretch"), Preparation(layout="nhwc")).shape == (1, 4, 4, 3)


@given(SIZES, INPUTS, RESIZES)
def test_a_map_over_the_input_is_cut_to_the_picture(size, model, resize):
    """A ramp over the input's columns comes back as the ramp over the picture's columns."""
    place = fit(size, model, resize)
    ramp = np.tile(np.arange(model[1] // 4, dtype=np.float32) + 0.5, (model[0] // 4, 1)) * 4
    back = place.map_back(ramp)
    centres = (np.arange(back.shape[1]) + 0.5) * size[1] / back.shape[1]
    boxes = np.stack([centres, centres, centres, centres], axis=1).astype(np.float32)
    expected = np.clip(place.boxes_in(boxes)[:, 0], 2, model[1] - 2)
    np.testing.assert_allclose(back[0], expected, atol=0.2)


def test_a_mask_is_cleared_outside_its_box():
    boxes = np.array([[20, 10, 40, 20], [0, 0, 80, 40]], np.float32)
    masks = in_boxes(np.ones((2, 4, 8), bool), boxes, (40, 80))
    assert np.argwhere(masks[0]).tolist() == [[1, 2], [1, 3]]
    assert masks[1].all()
