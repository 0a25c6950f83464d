from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from adatracker_deploy.sim.footprint import FreeSpace, Solid

COLUMN = Solid(x=2.0, y=0.0, radius=0.5, top=1.0)
TURNED_BOX = Solid(x=-3.0, y=1.0, yaw=math.pi / 4, half_x=1.0, half_y=0.5, top=1.0)
CROWN = Solid(x=0.0, y=5.0, radius=1.0, bottom=2.5, top=4.0)
SPACE = FreeSpace(8.0, 8.0, [COLUMN, TURNED_BOX, CROWN])


def clearance(x: float, y: float) -> float:
    return float(SPACE.clearance(np.array([[x, y]]))[0])


@pytest.mark.parametrize(
    ("x", "y", "expected"),
    [
        (3.0, 0.0, 0.5),  # beside the column
        (2.0, 0.0, -0.5),  # in its middle
        (-3.0, 1.0, -0.5),  # in the middle of the box, half a metre from its long sides
        (-3.0 - math.sqrt(0.5), 1.0 + math.sqrt(0.5), 0.5),  # off a long side of the turned box
        (7.0, -7.5, 0.5),  # near a wall
        (9.0, 0.0, -1.0),  # beyond a wall
        (0.0, 5.0, 3.0),  # under the crown: only the wall counts
    ],
)
def test_clearance_is_the_distance_to_what_is_nearest(x, y, expected):
    assert clearance(x, y) == pytest.approx(expected)


@given(x=st.floats(-9, 9), y=st.floats(-9, 9), radius=st.floats(0.05, 0.6))
def test_a_disc_that_is_pushed_out_touches_nothing(x, y, radius):
    assert clearance(*SPACE.push_out(x, y, radius)) >= radius - 1e-9


@given(x=st.floats(-7, 7), y=st.floats(-7, 7))
def test_a_disc_with_room_is_left_alone(x, y):
    radius = 0.3
    if clearance(x, y) >= radius:
        assert SPACE.push_out(x, y, radius) == (x, y)


def test_a_ball_touches_a_solid_only_at_its_height():
    assert SPACE.touches(2.0, 0.0, 1.2, 0.3)
    assert not SPACE.touches(2.0, 0.0, 1.4, 0.3)
    assert SPACE.touches(0.0, 5.0, 2.4, 0.3)
    assert not SPACE.touches(0.0, 5.0, 1.0, 0.3)
    assert SPACE.touches(7.8, 0.0, 1.0, 0.3)


def test_an_empty_arena_has_only_walls():
    empty = FreeSpace(2.0, 3.0, [])
    assert empty.clearance(np.zeros((1, 2)))[0] == 2.0
    assert empty.push_out(5.0, 0.0, 0.5) == (1.5, 0.0)
    assert not empty.touches(0.0, 0.0, 0.0, 0.5)
