"""People from glTF files: those that ship walk without sliding; what is no person is refused."""

from __future__ import annotations

import base64
import json
import math
import struct

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.core.geometry import Pose
from adatracker_deploy.core.messages import MaskClass
from adatracker_deploy.sim import World
from adatracker_deploy.sim.render.figure import (
    LARGEST_BYTES,
    MOST_TRIANGLES,
    Figure,
    Stride,
    check,
    shipped_people,
    stride_of,
)

pytest.importorskip("panda3d", reason="needs the extra 'world'")

PEOPLE = shipped_people()


def document_of(path):
    data = path.read_bytes()
    (length,) = struct.unpack_from("<I", data, 12)
    return json.loads(data[20 : 20 + length]), data[20 + length :]


def written(path, document, rest=b""):
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    head = struct.pack("<4sIII4s", b"glTF", 2, 20 + len(text) + len(rest), len(text), b"JSON")
    path.write_bytes(head + text + rest)
    return path


def test_at_least_24_people_ship_in_less_than_8_mb():
    assert len(PEOPLE) >= 24
    assert sum(path.stat().st_size for path in PEOPLE) < 8 << 20


@pytest.mark.parametrize("path", PEOPLE, ids=lambda path: path.stem)
def test_everybody_who_ships_is_a_person_of_a_person_s_height_who_takes_steps(path):
    figure = Figure(path)
    assert 1.45 < figure.height_m < 2.05  # soles and hair included
    assert 0.9 < figure.stride.cycle_m < 2.0


def test_people_differ_in_height():
    heights = [Figure(path).height_m for path in PEOPLE]
    assert max(heights) - min(heights) > 0.25


@pytest.mark.parametrize("speed_m_s", [0.5, 1.0, 1.5])
def test_the_foot_on_the_ground_stands_still_while_the_body_passes_over_it(speed_m_s):
    figure = Figure(PEOPLE[0])
    dt_s, slid = 1 / 60, []
    before = None
    for frame in range(180):
        walked = frame * dt_s * speed_m_s
        figure.pose(walked, speed_m_s, frame * dt_s)
        points = figure.points() + np.array([walked, 0.0, 0.0])
        lowest = int(points[:, 2].argmin())
        if before is not None:
            slid.append(abs(points[lowest, 0] - before[lowest, 0]))
        before = points
        assert abs(points[:, 2].min()) < (0.02 if speed_m_s >= 0.7 else 0.04)
    if speed_m_s >= 0.7:  # slower, standing is blended in
        assert np.median(slid) < 0.15 * speed_m_s * dt_s + 1e-3


@given(st.floats(0.2, 3.0), st.integers(8, 64), st.floats(0.0, 50.0))
def test_the_phase_of_a_walk_goes_round_once_a_cycle(cycle_m, moments, walked_m):
    stride = Stride(np.linspace(0.0, cycle_m, moments + 1))
    assert 0.0 <= stride.phase(walked_m) <= 1.0
    assert math.isclose(
        stride.phase(walked_m), stride.phase(walked_m + cycle_m) % 1.0, abs_tol=1e-6
    ) or math.isclose(abs(stride.phase(walked_m) - stride.phase(walked_m + cycle_m)), 1.0, abs_tol=1e-6)


def test_a_stride_is_measured_on_the_lowest_point():
    """A wheel of eight spokes that rolls covers its circumference."""
    spokes = np.arange(16) / 16 * 2 * np.pi
    moments = [
        np.stack([np.sin(spokes - turn), 0 * spokes, 1 - np.cos(spokes - turn)], axis=1)
        for turn in np.arange(64) / 64 * 2 * np.pi
    ]
    stride = stride_of(np.array(moments))
    assert stride.cycle_m == pytest.approx(2 * np.pi, rel=0.05)


def no_skin(document):
    del document["skins"]


def no_walk(document):
    document["animations"] = [{"name": "dance"}]


def no_animation(document):
    document["animations"] = []


def outside(document):
    document["buffers"][0]["uri"] = "body.bin"


def too_fine(document):
    for accessor in document["accessors"]:
        accessor["count"] = 3 * MOST_TRIANGLES + 3


@pytest.mark.parametrize(
    ("spoil", "why"),
    [
        (no_skin, "has no skeleton"),
        (no_walk, "needs an animation called 'walk', one cycle of two steps: has 'dance'"),
        (no_animation, "needs an animation called 'walk', one cycle of two steps: has none"),
        (outside, "refers to other files"),
        (too_fine, "triangles, more than"),
    ],
)
def test_a_file_without_what_a_walker_needs_is_refused(tmp_path, spoil, why):
    document, rest = document_of(PEOPLE[0])
    spoil(document)
    with pytest.raises(UsageError, match=why) as refused:
        check(written(tmp_path / "somebody.glb", document, rest))
    assert len(str(refused.value).splitlines()) == 1
    assert "somebody.glb" in str(refused.value)


@pytest.mark.parametrize("data", [b"", b"glTF", b"{}", b"\x89PNG\r\n", b"glTF" + bytes(40)])
def test_what_is_no_glb_is_refused(tmp_path, data):
    path = tmp_path / "file.glb"
    path.write_bytes(data)
    with pytest.raises(UsageError, match="not a binary glTF"):
        check(path)


def test_what_is_missing_or_too_large_is_refused(tmp_path):
    with pytest.raises(UsageError, match="No such file"):
        check(tmp_path / "nobody.glb")
    large = tmp_path / "large.glb"
    with large.open("wb") as file:
        file.truncate(LARGEST_BYTES + 1)
    with pytest.raises(UsageError, match="larger than"):
        check(large)


@given(st.binary(max_size=400))
def test_any_bytes_are_refused_in_one_sentence(tmp_path_factory, data):
    path = tmp_path_factory.mktemp("any") / "any.glb"
    document = b"glTF" + struct.pack("<III4s", 2, 20 + len(data), len(data), b"JSON") + data
    path.write_bytes(document)
    with pytest.raises(UsageError) as refused:
        check(path)
    assert len(str(refused.value).splitlines()) == 1


def test_a_person_whose_parts_do_not_fit_is_refused(tmp_path):
    document, _ = document_of(PEOPLE[0])
    with pytest.raises(UsageError, match="cannot be loaded"):
        Figure(written(tmp_path / "hollow.glb", document))


def test_a_person_who_hangs_on_no_bone_is_refused(tmp_path):
    """They would stand like a statue and slide."""
    document, rest = document_of(PEOPLE[0])
    for mesh in document["meshes"]:
        for primitive in mesh["primitives"]:
            del primitive["attributes"]["WEIGHTS_0"], primitive["attributes"]["JOINTS_0"]
    with pytest.raises(UsageError, match="'walk' does not move the feet") as refused:
        Figure(written(tmp_path / "statue.glb", document, rest))
    assert len(str(refused.value).splitlines()) == 1


def drawn(tmp_path, change=lambda document: None):
    """Return where the target is in a picture, and its colours there, with a changed file."""
    document, rest = document_of(PEOPLE[0])
    change(document)
    own = written(tmp_path / "own.glb", document, rest)
    world = World("simple_room", seed=3, cast=[own])  # with obstacles: the first body has the least opacity
    camera = Pose(world.start.x, world.start.y, 1.0, yaw=world.start.yaw)
    mask, rgb = world.picture(camera, math.radians(90.0), 120, 160)
    return mask == MaskClass.TARGET, rgb[mask == MaskClass.TARGET]


@pytest.mark.parametrize("mode", ["MASK", "BLEND"])
def test_somebody_transparent_is_drawn_opaque(tmp_path, mode):
    """Else their pixels would be taken for somebody else's, or for nobody's."""

    def clear(document):
        factor = {"baseColorFactor": [1.0, 1.0, 1.0, 0.2]}
        document["materials"][0] |= {"alphaMode": mode, "pbrMetallicRoughness": factor}

    where, colours = drawn(tmp_path)
    assert where.sum() > 500
    now, then = drawn(tmp_path, clear)
    np.testing.assert_array_equal(now, where)
    np.testing.assert_array_equal(then, colours)


def test_who_has_no_vertex_colours_has_their_material_s(tmp_path):
    def red(document):
        del document["meshes"][0]["primitives"][0]["attributes"]["COLOR_0"]
        document["materials"][0]["pbrMetallicRoughness"]["baseColorFactor"] = [0.5, 0.02, 0.02, 1.0]

    _, colours = drawn(tmp_path, red)
    assert (colours[:, 0] > 2.0 * colours[:, 1]).mean() > 0.95


def test_a_texture_that_is_transparent_is_drawn_opaque(tmp_path):
    clear = np.full((4, 4, 4), (30, 200, 30, 60), np.uint8)
    done, png = cv2.imencode(".png", clear)
    assert done

    def textured(document):
        primitive = document["meshes"][0]["primitives"][0]
        places = document["accessors"][primitive["attributes"]["POSITION"]]
        document["bufferViews"].append(dict(document["bufferViews"][places["bufferView"]]))
        view = len(document["bufferViews"]) - 1
        # Any coordinates will do: the picture is of one colour.
        document["accessors"].append({**places, "bufferView": view, "type": "VEC2"})
        primitive["attributes"]["TEXCOORD_0"] = len(document["accessors"]) - 1
        document["images"] = [{"uri": "data:image/png;base64," + base64.b64encode(png).decode()}]
        document["textures"] = [{"source": 0}]
        document["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"] = {"index": 0}

    where, _ = drawn(tmp_path)
    now, colours = drawn(tmp_path, textured)
    np.testing.assert_array_equal(now, where)
    assert (colours[:, 1] > colours[:, 0]).mean() > 0.9
