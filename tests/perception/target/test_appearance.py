"""The same clothes look alike and others do not, wherever in the picture they are."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from adatracker_deploy.perception.target.appearance import (
    UNKNOWN,
    appearances,
    likeness,
    mixed,
    stripes_known,
)
from tests.perception.target.walkers import CLOTHES

BOX = (100, 40, 140, 140)


def person(clothes, box=BOX, size=(200, 320), noise=6, seed=0):
    """A person in front of noise, with light and folds in what they wear."""
    chance = np.random.default_rng(seed)
    picture = chance.integers(0, 256, (*size, 3)).astype(float)
    left, top, right, bottom = box
    edges = [top + round(share * (bottom - top)) for share in (0.0, 0.33, 0.54, 1.0)]
    for begin, end, colour in zip(edges, edges[1:], CLOTHES[clothes], strict=False):
        picture[max(0, begin) : max(0, end), max(0, left) : max(0, right)] = colour
    return np.clip(picture + chance.normal(0, noise, picture.shape), 0, 255).astype(np.uint8)


def look(picture, box=BOX):
    return appearances(picture, np.array([box], np.float32))


@pytest.mark.parametrize("clothes", CLOTHES)
def test_the_same_clothes_are_alike_elsewhere_and_at_another_size(clothes):
    first = look(person(clothes))[0]
    assert likeness(look(person(clothes, seed=1)), first)[0] > 0.9
    far = (200, 90, 216, 130)
    assert likeness(look(person(clothes, far, seed=2), far), first)[0] > 0.9


@pytest.mark.parametrize(("a", "b"), [(a, b) for a in CLOTHES for b in CLOTHES if a < b])
def test_other_clothes_are_not(a, b):
    assert likeness(look(person(a)), look(person(b))[0])[0] < 0.5


def test_what_lies_beside_and_above_a_person_counts_for_nothing():
    picture = person("red")
    repainted = np.full_like(picture, 255)
    left, top, right, bottom = BOX
    inner = slice(top + 12, bottom - 10), slice(left + 10, right - 10)
    repainted[inner] = picture[inner]
    assert likeness(look(repainted), look(picture)[0])[0] == pytest.approx(1, abs=1e-5)


def test_red_in_rgb_is_not_blue():
    red, blue = np.zeros((2, 50, 50, 3), np.uint8)
    red[..., 0] = blue[..., 2] = 200
    box = (5, 5, 45, 45)
    assert likeness(look(red, box), look(blue, box)[0])[0] == 0


def test_each_person_gets_their_own_look_in_the_order_of_the_boxes():
    picture = np.hstack([person("red", size=(200, 160)), person("green", size=(200, 160))])
    boxes = np.array([(260, 40, 300, 140), BOX], np.float32)
    green, red = appearances(picture, boxes)
    assert likeness(look(person("green")), green)[0] > 0.9
    assert likeness(look(person("red")), red)[0] > 0.9
    assert appearances(picture, np.empty((0, 4), np.float32)).shape == (0, 3, 128)


@pytest.mark.parametrize(
    "box",
    [(-15, 40, 25, 140), (300, 40, 340, 140), (100, 120, 140, 220)],
    ids=["over the left", "over the right", "over the ground"],
)
def test_who_is_partly_outside_the_picture_still_looks_like_themselves(box):
    assert likeness(look(person("red", box), box), look(person("red"))[0])[0] > 0.6


WHOLE = (80, 40, 160, 248)
"""Of a person as tall as `_HEIGHT_OF_WIDTH` has it, whose feet a picture of 200 rows cuts off."""


@pytest.mark.parametrize(
    ("moved", "known"),
    [(0, [True, True, True]), (70, [True, True, False]), (-120, [False, True, True]), (150, [False] * 3)],
    ids=["their feet", "from the hips down", "their head and chest", "but the head"],
)
def test_of_whom_the_picture_cuts_off_the_stripes_that_are_left_are_compared(moved, known):
    """Stripes of the box would take the chest for the waist, and the waist for the legs."""
    left, top, right, bottom = WHOLE
    here = (left, top + moved, right, bottom + moved)
    shown = (left, max(0, top + moved), right, min(200, bottom + moved))
    cut_off = look(person("red", here), shown)
    assert cut_off.any(axis=2).tolist() == [known]
    for clothes in CLOTHES:
        alike = likeness(cut_off, look(person(clothes))[0])[0]
        of_known = (3 * alike - (3 - sum(known)) * UNKNOWN) / max(sum(known), 1)
        if any(known):
            assert of_known > 0.8 if clothes == "red" else of_known < 0.5
        else:
            assert alike == UNKNOWN


def test_what_a_picture_cuts_off_is_learnt_from_a_later_one():
    left, top, right, bottom = WHOLE
    half = look(person("red", (left, top + 70, right, bottom + 70)), (left, top + 70, right, 200))[0]
    assert not half[2].any()
    legs = mixed(half, look(person("blue"))[0], 0.1)[2]
    np.testing.assert_array_equal(legs, look(person("blue"))[0][2])
    np.testing.assert_array_equal(mixed(look(person("blue"))[0], half, 0.1)[2], legs)


corners = st.floats(-50, 400, width=32)
sides = st.floats(0.0625, 300, width=32)


@given(st.lists(st.tuples(corners, corners, sides, sides), min_size=1, max_size=3), st.integers(0, 9))
def test_wherever_a_box_is_a_stripe_is_whole_or_unknown_and_the_likeness_is_a_share(places, seed):
    picture = np.random.default_rng(seed).integers(0, 256, (120, 200, 3)).astype(np.uint8)
    boxes = np.array([(x, y, x + w, y + h) for x, y, w, h in places], np.float32)
    looks = appearances(picture, boxes)
    lengths = np.linalg.norm(looks, axis=2)
    np.testing.assert_allclose(lengths[lengths > 0], 1, atol=1e-5)
    for look_ in looks:
        assert ((likeness(looks, look_) >= 0) & (likeness(looks, look_) <= 1)).all()
    known = stripes_known(looks[0])
    assert likeness(looks, looks[0])[0] == pytest.approx((known + (3 - known) * UNKNOWN) / 3, abs=1e-5)


def test_nothing_is_more_alike_than_the_same_again():
    """By as little as a rounded root, and the observation would be refused."""
    for seed in range(20):
        picture = np.random.default_rng(seed).integers(0, 256, (120, 200, 3)).astype(np.uint8)
        same = appearances(picture, np.array([(20, 10, 80, 110)], np.float32))
        assert 1 - 1e-6 < likeness(same, same[0])[0] <= 1


@pytest.mark.parametrize("corner", [(0, 0), (199, 0), (0, 119), (199, 119), (60, 60)])
def test_a_box_of_one_pixel_looks_like_that_pixel(corner):
    picture = person("white", size=(120, 200))
    x, y = corner
    picture[y, x] = (250, 0, 0)
    red = look(np.full_like(picture, (250, 0, 0)), (100, 10, 140, 110))[0]
    pixel = look(picture, (x, y, x + 1, y + 1))[0]
    assert pixel.any()
    np.testing.assert_array_equal(pixel[pixel.any(axis=1)], red[pixel.any(axis=1)])


@given(
    arrays.arrays(np.float32, (2, 3, 128), elements=st.floats(0, 1, width=32)),
    st.floats(0, 1),
)
def test_a_mixed_look_is_a_look_between_the_two(raw, share):
    counts = raw + np.float32(1e-3)
    old, new = np.sqrt(counts / counts.sum(axis=2, keepdims=True))
    both = mixed(old, new, share)
    np.testing.assert_allclose(np.linalg.norm(both, axis=1), 1, atol=1e-5)
    np.testing.assert_allclose(np.square(both), (1 - share) * old**2 + share * new**2, atol=1e-5)
