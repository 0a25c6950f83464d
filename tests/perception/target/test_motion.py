"""A camera's motion is measured within a pixel, ignoring people; one that cannot be measured is STILL."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from adatracker_deploy.perception.target.motion import STILL, CameraMotion

NOBODY = np.empty((0, 4), np.float32)
SIZE = (240, 320)


def texture(seed=0, size=SIZE, cell=12):
    """Return a picture of random blotches with edges between them."""
    coarse = np.random.default_rng(seed).integers(0, 256, (size[0] // cell + 1, size[1] // cell + 1, 3))
    fine = cv2.resize(coarse.astype(np.uint8), None, fx=cell, fy=cell, interpolation=cv2.INTER_CUBIC)
    return np.ascontiguousarray(fine[: size[0], : size[1]])


def moved(picture, motion):
    height, width = picture.shape[:2]
    return cv2.warpAffine(picture, motion, (width, height), borderMode=cv2.BORDER_REFLECT)


def about_the_middle(turn_deg=0.0, zoom=1.0, shift=(0.0, 0.0), size=SIZE):
    motion = cv2.getRotationMatrix2D((size[1] / 2, size[0] / 2), turn_deg, zoom)
    motion[:, 2] += shift
    return motion


def furthest_px(found, true, size=SIZE):
    """Return the greatest error of the found motion at a corner of the picture, per axis, px."""
    corners = np.array([(x, y, 1) for x in (0, size[1]) for y in (0, size[0])])
    return np.abs(corners @ (np.asarray(found) - true).T).max()


def measured_motion(first, second, people=(NOBODY, NOBODY)):
    camera = CameraMotion()
    assert camera(first, people[0]) is STILL
    return camera(second, people[1])


@pytest.mark.parametrize(
    "true",
    [
        about_the_middle(shift=(14, 0)),
        about_the_middle(shift=(-9.5, 6.25)),
        about_the_middle(zoom=1.06),
        about_the_middle(zoom=0.95, shift=(5, -3)),
        about_the_middle(turn_deg=4),
        about_the_middle(turn_deg=-3, zoom=1.03, shift=(-6, 4)),
    ],
    ids=["pan", "pan and tilt", "forward", "backward", "roll", "all"],
)
def test_a_motion_is_measured_within_a_pixel(true):
    first = texture()
    assert furthest_px(measured_motion(first, moved(first, true)), true) < 1


@settings(max_examples=25)
@given(st.floats(-20, 20), st.floats(-15, 15), st.floats(-3, 3), st.floats(0.96, 1.04))
def test_any_small_motion_is_measured_within_a_pixel(right, down, turn_deg, zoom):
    true = about_the_middle(turn_deg, zoom, (right, down))
    first = texture(1)
    assert furthest_px(measured_motion(first, moved(first, true)), true) < 1


@pytest.mark.parametrize("share", [-0.3, -0.2, -0.12, 0.12, 0.2, 0.3])
@pytest.mark.parametrize("seed", range(3))
def test_a_turn_that_moves_the_picture_by_a_third_of_its_width_is_measured(share, seed):
    """A robot that turns at 2 rad/s moves it by a sixth from one picture to the next, at 10 a second."""
    world = texture(seed, (240, 640))
    shift = round(share * 320)
    first, second = (np.ascontiguousarray(world[:, at : at + 320]) for at in (160, 160 - shift))
    assert furthest_px(measured_motion(first, second), about_the_middle(shift=(shift, 0))) < 1


def test_a_person_whom_the_camera_turns_with_does_not_hide_the_turn():
    world, person = texture(3, (240, 640)), (110, 20, 210, 230)
    left, top, right, bottom = person
    pictures = [np.ascontiguousarray(world[:, at : at + 320]) for at in (160, 200)]
    for picture in pictures:
        picture[top:bottom, left:right] = texture(4, (240, 320), cell=7)[top:bottom, left:right]
    people = np.array([person], np.float32)
    assert furthest_px(measured_motion(*pictures, (people, people)), about_the_middle(shift=(-40, 0))) < 1


@pytest.mark.parametrize("size", [(480, 640), (720, 1280), (120, 160)])
def test_the_motion_is_in_pixels_of_the_picture_whatever_its_size(size):
    true = about_the_middle(2, 1.02, (0.03 * size[1], -0.02 * size[1]), size)
    first = texture(2, size, cell=size[1] // 26)
    assert furthest_px(measured_motion(first, moved(first, true), (NOBODY,) * 2), true, size) < size[1] / 320


def test_each_picture_is_compared_with_the_one_before():
    first, camera = texture(), CameraMotion()
    for number in range(5):
        picture = moved(first, about_the_middle(shift=(6 * number, 0)))
        found = camera(picture, NOBODY)
        assert furthest_px(found, about_the_middle(shift=(6, 0)) if number else STILL) < 1


def test_people_who_walk_before_a_camera_that_stands_do_not_move_it():
    background, coat = texture(3), texture(4, cell=8)
    pictures, people = [], []
    for left in (20, 29):  # two thirds of the picture, or it would not matter
        picture = background.copy()
        picture[20:240, left : left + 230] = coat[20:240, 20:250]
        pictures.append(picture)
        people.append(np.array([(left, 20, left + 230, 240)], np.float32))
    assert furthest_px(measured_motion(*pictures, (NOBODY, NOBODY)), STILL) > 5  # without their boxes
    assert furthest_px(measured_motion(*pictures, people), STILL) < 0.5


def test_boxes_over_the_edges_hide_what_is_in_them_and_nothing_else():
    first = texture()
    boxes = np.array([(-40, -10, 30, 300), (300, -5, 400, 500)], np.float32)
    true = about_the_middle(shift=(8, 3))
    assert furthest_px(measured_motion(first, moved(first, true), (boxes, boxes)), true) < 1


blank = np.full((*SIZE, 3), 128, np.uint8)


@pytest.mark.parametrize(
    ("first", "second"),
    [
        (blank, blank),
        (blank, texture()),
        (texture(), blank),
        (texture(5), texture(6)),
        (texture(), moved(texture(), about_the_middle(shift=(150, 0)))),
        (texture(), moved(texture(), about_the_middle(zoom=1.6))),
    ],
    ids=["blank", "light on", "light off", "cut", "leap", "lens changed"],
)
def test_what_cannot_be_told_is_no_motion(first, second):
    np.testing.assert_array_equal(measured_motion(first, second), STILL)


def test_a_picture_that_is_all_people_is_no_motion():
    everywhere = np.array([(0, 0, 320, 240)], np.float32)
    first = texture()
    found = measured_motion(first, moved(first, about_the_middle(shift=(9, 0))), (everywhere, everywhere))
    np.testing.assert_array_equal(found, STILL)


@pytest.mark.parametrize("size", [(480, 640), (240, 100), (12, 400), (1, 1)])
def test_a_picture_of_another_size_begins_anew(size):
    camera = CameraMotion()
    camera(texture(), NOBODY)
    other = cv2.resize(texture(), size[::-1])
    assert furthest_px(camera(other, NOBODY), STILL, size) < 1 or size == (480, 640)
    camera(other, NOBODY)
    camera(texture(), NOBODY)
    true = about_the_middle(shift=(7, 0))
    assert furthest_px(camera(moved(texture(), true), NOBODY), true) < 1


def test_nobody_may_write_into_what_stands_for_no_motion():
    camera = CameraMotion()
    camera(texture(), NOBODY)
    camera(moved(texture(), about_the_middle(shift=(9, 0))), NOBODY)
    np.testing.assert_array_equal(STILL, np.eye(2, 3))
