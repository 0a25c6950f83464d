"""A mesh's motion between the moments at which its skeleton held it."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from adatracker_deploy.sim.render.figure import WALK, Figure, shipped_people
from adatracker_deploy.sim.render.motion import Cycle, Flesh, column


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


def test_bones_move_vertices_as_pandas_own_do():
    p3d = pytest.importorskip("panda3d.core", reason="needs the extra 'world'")
    gltf = pytest.importorskip("gltf")
    root = p3d.NodePath("root")
    model = p3d.NodePath(gltf.load_model(str(shipped_people()[0])))
    model.reparent_to(root)
    model.set_h(90.0)
    character = model.find("**/+Character").node()
    controls = p3d.AnimControlCollection()
    p3d.auto_bind(character, controls, ~0)
    flesh = Flesh(model, root)
    parts = []
    for node in model.find_all_matches("**/+GeomNode"):
        for geom in node.node().modify_geoms():
            data = geom.modify_vertex_data()
            table = p3d.TransformBlendTable(data.get_transform_blend_table())
            for at in range(table.get_num_blends()):
                blend = p3d.TransformBlend(table.get_blend(at))
                blend.normalize_weights()  # the loader reads a weight of 255 as 255
                table.set_blend(at, blend)
            data.set_transform_blend_table(table)
            parts.append((node, data))
    for frame in (0, 11, 23):
        controls.find_anim(WALK).pose(frame)
        character.force_update()
        theirs = []
        for node, data in parts:
            moved = p3d.GeomVertexData(data.animate_vertices(True, p3d.Thread.get_main_thread()))
            moved.transform_vertices(node.get_mat(root))
            theirs.append(np.hstack([column(moved, "vertex"), column(moved, "normal")]))
        places, normals = np.split(np.concatenate(theirs), 2, axis=1)
        normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-9)
        assert flesh.vertices()[:, :3] == pytest.approx(places, abs=2e-6)
        assert flesh.vertices()[:, 3:] == pytest.approx(normals, abs=0.02)


@pytest.mark.parametrize("mirrored", [False, True])
def test_outside_stays_outside_in_a_mirror(mirrored):
    p3d = pytest.importorskip("panda3d.core", reason="needs the extra 'world'")
    data = p3d.GeomVertexData("point", p3d.GeomVertexFormat.get_v3n3(), p3d.Geom.UH_static)
    p3d.GeomVertexWriter(data, "vertex").add_data3(1.0, 2.0, 3.0)
    p3d.GeomVertexWriter(data, "normal").add_data3(0.6, 0.0, 0.8)
    node = p3d.GeomNode("node")
    node.add_geom(p3d.Geom(data))
    root = p3d.NodePath("root")
    side = -1.0 if mirrored else 1.0
    root.attach_new_node(node).set_scale(side, 1.0, 1.0)
    assert Flesh(root, root).vertices() == pytest.approx(np.array([[side, 2.0, 3.0, side * 0.6, 0.0, 0.8]]))
