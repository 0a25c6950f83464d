"""A mesh's motion between the moments at which its skeleton held it."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from adatracker_deploy.sim.render.figure import Figure, shipped_people
from adatracker_deploy.sim.render.motion import Cycle, column


@given(st.integers(1, 12), st.integers(-3, 3), st.floats(0.0, 1.0, exclude_max=True))
def test_a_cycle_goes_through_its_moments_and_straight_between_them(count, turns, share):
    moments = np.random.default_rng(count).normal(size=(count, 5, 6)).astype(np.float32)
    cycle = Cycle(moments, 1.0)
    for k in range(count):
        between = (1 - share) * moments[k] + share * moments[(k + 1) % count]
        assert cycle.at(turns + (k + share) / count) == pytest.approx(between, abs=1e-4)


def test_what_is_drawn_is_what_is_posed():
    pytest.importorskip("panda3d", reason="needs the extra 'world'")
    figure = Figure(shipped_people()[0])
    for walked_m, speed_m_s, t_s in ((0.4, 1.2, 0.0), (0.0, 0.0, 1.7), (2.3, 0.5, 3.0)):
        figure.pose(walked_m, speed_m_s, t_s)
        drawn = []
        for node in figure.root.find_all_matches("**/+GeomNode"):
            raised = node.get_mat(figure.root).get_row3(3)
            data = [geom.get_vertex_data() for geom in node.node().get_geoms()]
            drawn += [column(one, "vertex") + np.array(list(raised)) for one in data]
        assert np.concatenate(drawn) == pytest.approx(figure.points(), abs=1e-6)


def test_somebody_is_the_same_to_the_bit_however_often_they_are_loaded():
    """Else what the eyes see, and so a whole episode, depends on where in memory they came to lie."""
    pytest.importorskip("panda3d", reason="needs the extra 'world'")
    first, *others = kept = [Figure(shipped_people()[1]) for _ in range(6)]
    for figure in kept:
        figure.pose(0.7, 0.5, 1.3)
    for other in others:
        np.testing.assert_array_equal(other.points(), first.points())
        assert other.height_m == first.height_m
