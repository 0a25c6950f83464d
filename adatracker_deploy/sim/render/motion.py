"""The motion of a mesh, taken from its skeleton once: moments of a cycle, between which vertices go straight.

To move 3,500 vertices by their skeleton takes 3 ms of a core, to mix two moments a hundredth of that.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

FPS = 30
"""Frames a second of an animation."""
_MOVING = {"vertex", "normal", "transform_blend", "transform_index", "transform_weight"}
"""Columns of Panda3D's vertex data that a skeleton moves, or that say how."""


@dataclass(frozen=True, slots=True)
class Cycle:
    """A motion that begins again where it ends.

    Attributes:
        moments: the place of each vertex, m, x ahead, z up, and its normal, evenly spaced in time, (M, V, 6).
        lasts_s: how long it takes.
    """

    moments: NDArray[np.float32]
    lasts_s: float

    def at(self, phase: float) -> NDArray[np.float32]:
        """Return the vertices, (V, 6), at a share of the cycle; whole cycles do not count."""
        count = len(self.moments)
        place = phase % 1.0 * count
        before, share = int(place) % count, np.float32(place % 1.0)
        first, second = self.moments[before], self.moments[(before + 1) % count]
        return np.asarray(first + share * (second - first), np.float32)


@dataclass(frozen=True, slots=True)
class Passage:
    """A motion from one posture to another.

    Attributes:
        moments: as a cycle's.
    """

    moments: NDArray[np.float32]

    def at(self, share: float) -> NDArray[np.float32]:
        """Return the vertices, (V, 6), after a share of the motion's time, 0 to 1."""
        place = min(max(share, 0.0), 1.0) * (len(self.moments) - 1)
        before = min(int(place), len(self.moments) - 2)
        first, second = self.moments[before], self.moments[before + 1]
        return np.asarray(first + np.float32(place - before) * (second - first), np.float32)


def cycles(model: Any, flesh: Flesh, most: Mapping[str, int]) -> dict[str, Cycle]:
    """Return the motions of an animated model by name.

    Args:
        model: a Panda3D NodePath with a character.
        flesh: the model's.
        most: how many moments to keep at most, of each animation that is wanted.
    """
    from panda3d import core as p3d

    character = model.find("**/+Character").node()
    controls = p3d.AnimControlCollection()
    p3d.auto_bind(character, controls, ~0)
    found = {}
    character.get_bundle(0).set_frame_blend_flag(True)
    for name, kept in most.items():
        control = controls.find_anim(name)
        if control is None:
            continue
        last = control.get_num_frames() - 1  # where the body is as it was at first
        moments = []
        for moment in range(count := min(max(last, 1), kept)):
            control.pose(moment * last / count)
            character.force_update()
            moments.append(flesh.vertices())
        found[name] = Cycle(np.array(moments), max(last, 1) / FPS)
    return found


class Skin:
    """The surface of a model, moved by its vertices.

    Args:
        model: a Panda3D NodePath.
        parent: the NodePath under which it is shown.
        reach_m: how far from its parent's origin it reaches at most.
    """

    def __init__(self, model: Any, parent: Any, reach_m: float) -> None:
        from panda3d import core as p3d

        self._arrays: list[tuple[Any, slice]] = []
        first = 0
        for node in model.find_all_matches("**/+GeomNode"):
            shown = p3d.GeomNode(node.get_name())
            for geom, state in zip(node.node().get_geoms(), node.node().get_geom_states(), strict=True):
                data = _rigid(geom.get_vertex_data())
                copy = geom.make_copy()
                copy.set_vertex_data(data)
                shown.add_geom(copy, state)
                self._arrays.append((data, slice(first, first + data.get_num_rows())))
                first += data.get_num_rows()
            shown.set_bounds(p3d.BoundingSphere((0.0, 0.0, 0.0), reach_m))
            shown.set_final(True)
            parent.attach_new_node(shown).set_state(node.get_net_state())

    def move(self, vertices: NDArray[np.float32]) -> None:
        """Show these vertices, (V, 6), in the order of a cycle's."""
        for data, rows in self._arrays:
            memoryview(data.modify_array(0)).cast("B").cast("f")[:] = vertices[rows].reshape(-1).data


class Flesh:
    """All vertices of a model, hung on the bones of its skeleton.

    Panda3D could move them, but it adds a vertex's bones up in the order of their addresses in memory. So
    somebody who was loaded twice differed in the last bit, a picture of them in a pixel, and in the end a
    whole episode that is seen by it. Here bones are added up by name.

    Args:
        model: a Panda3D NodePath with a character.
        root: the NodePath in whose frame the vertices are wanted.
    """

    def __init__(self, model: Any, root: Any) -> None:
        self._root = root
        self._parts = [
            (node, _Hung.of(geom.get_vertex_data()))
            for node in model.find_all_matches("**/+GeomNode")
            for geom in node.node().get_geoms()
        ]

    def vertices(self) -> NDArray[np.float32]:
        """Return the vertices as the skeleton holds them now: places, m, and normals, (V, 6)."""
        return np.concatenate([part.moved(_array(node.get_mat(self._root))) for node, part in self._parts])


@dataclass(frozen=True, slots=True)
class _Hung:
    """Vertices as they were modelled, and what they hang on."""

    points: NDArray[np.float64]
    """(V, 3)."""
    normals: NDArray[np.float64]
    """(V, 3)."""
    bones: list[Any]
    """Panda3D's transforms, J of them."""
    hung_on: NDArray[np.intp]
    """Places in `bones`, (V, K); J is a bone that never moves."""
    weights: NDArray[np.float64]
    """(V, K), each row adding up to 1."""

    @classmethod
    def of(cls, data: Any) -> _Hung:
        """Read Panda3D's vertex data."""
        from panda3d import core as p3d

        points = column(data, "vertex")
        has_normals = data.has_column("normal")
        normals = column(data, "normal") if has_normals else np.tile((0.0, 0.0, 1.0), (len(points), 1))
        table = data.get_transform_blend_table()
        blends = [_by_name(table.get_blend(at)) for at in range(table.get_num_blends())] if table else []
        if not any(blends):
            return cls(points, normals, [], np.zeros((len(points), 1), np.intp), np.ones((len(points), 1)))
        bones = list(dict.fromkeys(bone for blend in blends for bone, _ in blend))
        hung_on = np.full((len(blends), max(map(len, blends))), len(bones), np.intp)
        weights = np.zeros(hung_on.shape)
        for row, blend in enumerate(blends):
            for at, (bone, weight) in enumerate(blend):
                hung_on[row, at], weights[row, at] = bones.index(bone), weight
        whole = np.array([sum(row) for row in weights.tolist()])  # the loader reads a weight of 255 as 255
        hung_on[whole <= 0.0, 0], weights[whole <= 0.0, 0], whole[whole <= 0.0] = len(bones), 1.0, 1.0
        reader = p3d.GeomVertexReader(data, "transform_blend")
        which = [reader.get_data1i() for _ in points]
        return cls(points, normals, bones, hung_on[which], (weights / whole[:, None])[which])

    def moved(self, to_root: NDArray[np.float64]) -> NDArray[np.float32]:
        """Return places and normals (V, 6) as the bones are now, moved by one more matrix (4, 4)."""
        bones = np.stack([*(_matrix_of(bone) for bone in self.bones), np.eye(4)])
        held = np.zeros((len(self.points), 4, 4))
        for weight, bone in zip(self.weights.T, self.hung_on.T, strict=True):
            held += weight[:, None, None] * bones[bone]
        points = _through(to_root, _through(held, self.points) + held[:, 3, :3]) + to_root[3, :3]
        normals = _through(_cofactors(to_root), _through(_cofactors(held), self.normals))
        x, y, z = normals.T
        normals = normals / np.maximum(np.sqrt(x * x + y * y + z * z), 1e-9)[:, None]
        return np.concatenate([points, normals], axis=1).astype(np.float32)


def _by_name(blend: Any) -> list[tuple[Any, float]]:
    """Return the bones of one of Panda3D's blends, and their weights."""
    hung = ((blend.get_transform(at), blend.get_weight(at)) for at in range(blend.get_num_transforms()))
    return sorted(hung, key=lambda one: (one[0].get_joint().get_name(), one[1]))


def _matrix_of(bone: Any) -> NDArray[np.float64]:
    from panda3d import core as p3d

    matrix = p3d.LMatrix4()
    bone.get_matrix(matrix)
    return _array(matrix)


def _array(matrix: Any) -> NDArray[np.float64]:
    """Return a matrix of Panda3D's, which stands to the right of what it moves, (4, 4)."""
    return np.array([[matrix.get_cell(row, column) for column in range(4)] for row in range(4)])


def _cofactors(matrices: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return what moves normals as matrices (..., 4, 4) move places, but for the length, (..., 3, 3)."""
    first, second, third = (matrices[..., at, :3] for at in range(3))
    found = np.stack([np.cross(second, third), np.cross(third, first), np.cross(first, second)], axis=-2)
    x, y, z = (first[..., at] * found[..., 0, at] for at in range(3))
    return found * np.where(x + y + z < 0.0, -1.0, 1.0)[..., None, None]  # a mirror leaves outside outside


def _through(matrices: NDArray[np.float64], ways: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return ways (V, 3), turned by matrices (..., 3 or 4, 3 or 4).

    Added up one by one: how a library of linear algebra does it depends on the machine.
    """
    x, y, z = (ways[:, at, None] * matrices[..., at, :3] for at in range(3))
    return np.asarray(x + y + z)


def column(data: Any, name: str) -> NDArray[np.float64]:
    """Return a column of three floats of Panda3D's vertex data, (V, 3)."""
    index = data.get_format().get_array_with(name)
    array = data.get_format().get_array(index)
    start = array.get_column(name).get_start()
    rows = np.frombuffer(data.get_array(index).get_handle().get_data(), np.uint8).reshape(
        -1, array.get_stride()
    )
    return np.ascontiguousarray(rows[:, start : start + 12]).view(np.float32).astype(np.float64)


def _rigid(data: Any) -> Any:
    """Return vertex data without a skeleton: array 0 has place and normal, array 1 colours and the like."""
    from panda3d import core as p3d

    moving = p3d.GeomVertexArrayFormat()
    moving.add_column("vertex", 3, p3d.Geom.NT_float32, p3d.Geom.C_point)
    moving.add_column("normal", 3, p3d.Geom.NT_float32, p3d.Geom.C_normal)
    rest = p3d.GeomVertexArrayFormat()
    for old in data.get_format().get_columns():
        name = old.get_name()
        if name.get_basename() not in _MOVING:
            rest.add_column(name, old.get_num_components(), old.get_numeric_type(), old.get_contents())
    layout = p3d.GeomVertexFormat()
    layout.add_array(moving)
    layout.add_array(rest)
    rigid = p3d.GeomVertexData(
        data.get_name(), p3d.GeomVertexFormat.register_format(layout), p3d.Geom.UH_dynamic
    )
    rigid.copy_from(data, False)
    return rigid
