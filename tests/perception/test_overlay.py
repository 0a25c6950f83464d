"""The overlay draws everything in its colour and in its place, and changes nothing else in the picture."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from adatracker_deploy.core.mask_png import PALETTE
from adatracker_deploy.core.messages import Box, MaskClass, Observation, TargetState
from adatracker_deploy.perception.overlay import STATE_COLOURS, WHITE, Drive, overlay, shown_size

HEIGHT, WIDTH = 480, 640
PEOPLE = {MaskClass.TARGET: (60, 80), MaskClass.PERSON: (20, 40), MaskClass.OBSTACLE: (110, 130)}
"""Columns of the class mask, 160 wide, that each fills from row 60 to 100."""


SMOOTHED = 12
"""Tolerance for the colour of a smoothed line."""


def grey(value=90, size=(HEIGHT, WIDTH)):
    return np.full((*size, 3), value, np.uint8)


def seen(state=TargetState.TRACKED, *, classes=tuple(PEOPLE), confidence=0.87):
    mask = np.zeros((160, 160), np.uint8)
    for value in classes:
        left, right = PEOPLE[value]
        mask[60:100, left:right] = value
    box = Box.of_mask(mask) if state in (TargetState.TRACKED, TargetState.REACQUIRED) else None
    return Observation(mask, box, confidence if box else 0.0, 0, 7, state)


def has(picture, colour, tolerance=0):
    return bool((np.abs(picture.astype(int) - colour).max(axis=-1) <= tolerance).any())


def changed(one, other):
    """Return where two pictures differ: left, top, right, bottom as fractions."""
    rows, columns = np.nonzero((one != other).any(axis=-1))
    height, width = one.shape[:2]
    return columns.min() / width, rows.min() / height, columns.max() / width, rows.max() / height


@pytest.mark.parametrize("value", PEOPLE)
def test_each_class_is_tinted_in_its_own_colour_where_it_is(value):
    nothing = overlay(grey(), seen(TargetState.LOST, classes=()), "1 s")
    tinted = overlay(grey(), seen(TargetState.LOST, classes=(value,)), "1 s")
    left, right = PEOPLE[value]
    place = changed(tinted, nothing)
    assert place == pytest.approx((left / 160, 60 / 160, right / 160, 100 / 160), abs=0.005)
    middle = tinted[HEIGHT // 2, (left + right) * WIDTH // 320].astype(int)
    assert np.sign(middle - 90).tolist() == np.sign(np.array(PALETTE[value]) - 90).tolist()
    assert has(tinted, PALETTE[value], SMOOTHED)  # its outline


@pytest.mark.parametrize("state", [*TargetState, None])
def test_the_state_is_told_by_its_colour(state):
    picture = overlay(grey(), seen(state, classes=()), "1 s")
    assert has(picture[:80, :300], STATE_COLOURS[state])
    others = {colour for other, colour in STATE_COLOURS.items() if other != state}
    assert not any(has(picture, colour) for colour in others - {STATE_COLOURS[None]})


def test_a_box_is_drawn_around_the_target_while_it_is_seen():
    tracked = overlay(grey(), seen(), "1 s")
    coasting = overlay(grey(), seen(TargetState.COASTING), "1 s")
    top, dark = 60 * HEIGHT // 160, (20, 22, 26)
    for picture, drawn in ((tracked, True), (coasting, False)):
        above = picture[top - 3 : top, 62 * WIDTH // 160 : 78 * WIDTH // 160]
        assert has(above, dark, SMOOTHED) == drawn  # the darker line beneath


def test_likeness_number_and_time_are_written_and_only_in_their_corner():
    picture = overlay(grey(), seen(), "1.23 s")
    for other in (
        overlay(grey(), seen(confidence=0.42), "1.23 s"),
        overlay(grey(), seen(), "9.87 s"),
    ):
        left, top, right, bottom = changed(picture, other)
        assert 0 < left < right < 0.4
        assert 0 < top < bottom < 0.2


@pytest.mark.parametrize("background", [0, 128, 255])
def test_text_stands_out_on_any_background(background):
    corner = overlay(grey(background), seen(classes=()), "1 s")[:70, :200]
    letters = (np.abs(corner.astype(int) - WHITE).max(axis=-1) < 30).sum()
    panel = corner[12, 12].max()
    assert letters > 30 if background < 255 else letters > 0
    assert panel < 100


def dial(picture):
    """Return the middle of what is white in the dial, right and up of its centre."""
    corner = picture[-110:, :110]
    rows, columns = np.nonzero(np.abs(corner.astype(int) - WHITE).max(axis=-1) < 8)
    return columns.mean(), -rows.mean()


@pytest.mark.parametrize(
    ("moves", "right", "up"),
    [
        ({"forward": 0.9, "yaw": 0.0}, 0, 1),
        ({"forward": -0.9, "yaw": 0.0}, 0, -1),
        ({"forward": 0.0, "yaw": 0.9}, -1, 0),
        ({"forward": 0.0, "yaw": -0.9}, 1, 0),
    ],
)
def test_the_arrow_points_where_the_robot_would_go(moves, right, up):
    there = dial(overlay(grey(), seen(), "1 s", Drive(moves=moves)))
    opposite = dial(overlay(grey(), seen(), "1 s", Drive(moves={k: -v for k, v in moves.items()})))
    shift = np.subtract(there, opposite)
    assert np.sign(np.where(np.abs(shift) < 3, 0, shift)).tolist() == [right, up]


@pytest.mark.parametrize(
    "moves", [None, {"forward": float("nan"), "yaw": 0.0}, {"yaw": 9e9}, {"forward": float("inf")}, {}]
)
def test_what_a_broken_policy_says_can_be_drawn(moves):
    overlay(grey(), seen(), "1 s", Drive(moves=moves))


@pytest.mark.parametrize("channels", [1, 3])
def test_the_networks_input_is_shown_pixel_by_pixel(channels):
    sees = np.random.default_rng(0).integers(0, 256, (64, 64, channels)).astype(np.uint8)
    picture = overlay(grey(), seen(), "1 s", Drive(moves=None, sees=sees))
    inset = picture[HEIGHT // 2 :, WIDTH // 2 :].astype(int)
    wanted = np.broadcast_to(sees, (64, 64, 3))
    found = [
        (top, left)
        for top in range(inset.shape[0] - 64)
        for left in range(inset.shape[1] - 64)
        if (inset[top, left] == wanted[0, 0]).all()
        and (inset[top : top + 64, left : left + 64] == wanted).all()
    ]
    assert len(found) == 1


def test_the_picture_that_was_given_stays_as_it_was():
    rgb = grey()
    overlay(rgb, seen(), "1 s", Drive(moves={"forward": 1.0}))
    assert (rgb == 90).all()


@given(st.integers(1, 8192), st.integers(1, 8192))
def test_any_size_is_shown_at_an_even_one_that_fits(width, height):
    shown = shown_size(width, height)
    assert all(side % 2 == 0 and side >= 2 for side in shown)
    assert shown[0] <= 1280
    assert shown[1] <= 720


def test_usual_sizes_keep_their_shape():
    assert [
        shown_size(*size) for size in ((640, 480), (1280, 720), (1920, 1080), (160, 160), (320, 240))
    ] == [
        (640, 480),
        (1280, 720),
        (1280, 720),
        (360, 360),
        (480, 360),
    ]


@pytest.mark.parametrize("size", [(1, 1), (2, 900), (900, 2), (16, 16)])
def test_tiny_and_thin_pictures_can_be_drawn_over(size):
    drive = Drive(moves={"forward": 1.0, "yaw": 1.0}, sees=np.zeros((64, 64, 3), np.uint8))
    picture = overlay(grey(size=size), seen(), "1 s", drive)
    assert picture.shape[1::-1] == shown_size(size[1], size[0])
