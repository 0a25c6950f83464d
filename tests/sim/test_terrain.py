from __future__ import annotations

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from adatracker_deploy.sim.caster import Caster, Rays
from adatracker_deploy.sim.scenes import build_scene
from adatracker_deploy.sim.terrain import FLAT, Terrain

VILLAGE = build_scene("snow_village", np.random.default_rng(0))
GROUND = Caster.of_surfaces(VILLAGE)


@settings(max_examples=200)
@given(
    column=st.integers(-12, 12),
    row=st.integers(-12, 12),
    u=st.floats(0.01, 0.99),
    v=st.floats(0.01, 0.99),
)
def test_the_height_is_where_a_ray_from_above_meets_the_ground(column, row, u, v):
    assume(abs(u - v) > 0.01)  # along the very edges of its triangles a ray may slip through
    x, y = 1.5 * (column + u), 1.5 * (row + v)
    down = Rays(np.array([x, y, 50.0]), np.array([[0.0], [0.0], [-1.0]]))
    _, distance = GROUND.cast(down)
    assert 50.0 - distance[0] == pytest.approx(VILLAGE.terrain.height(x, y), abs=1e-5)


def test_hills_are_uneven_but_a_small_robot_climbs_them():
    heights = np.array([VILLAGE.terrain.height(x, y) for x in range(-20, 21) for y in range(-20, 21)])
    slopes = [abs(VILLAGE.terrain.slope(x, y, 0.0)[1]) for x in range(-20, 21) for y in range(-20, 21)]
    assert np.ptp(heights) > 0.5
    assert max(slopes) < 0.3


def test_flat_ground_is_level_at_zero():
    assert FLAT.is_flat
    assert FLAT.height(3.0, -100.0) == 0.0
    assert FLAT.slope(1.0, 2.0, 0.7) == (0.0, 0.0)


def test_uphill_ahead_lifts_the_nose_and_uphill_on_the_left_rolls_to_the_right():
    plane = Terrain(half_m=10.0, heights=np.tile(np.linspace(-1.0, 1.0, 11), (11, 1)))
    roll, pitch = plane.slope(0.0, 0.0, yaw=0.0)
    assert pitch == pytest.approx(-0.1, abs=0.01)
    assert roll == pytest.approx(0.0)
    roll, pitch = plane.slope(0.0, 0.0, yaw=-np.pi / 2)
    assert roll == pytest.approx(0.1, abs=0.01)
    assert pitch == pytest.approx(0.0, abs=1e-9)


def test_beyond_the_grid_the_edge_goes_on():
    slope = Terrain(half_m=1.0, heights=np.array([[0.0, 1.0], [0.0, 1.0]]))
    assert slope.height(50.0, 0.0) == 1.0
    assert slope.height(-50.0, 0.0) == 0.0
