"""A mesh of coloured triangles with skinning weights: made of parts of a body, simplified, joined. Pure."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import fast_simplification
import numpy as np
from numpy.typing import NDArray

from people.base_mesh import Body, Indices

Array = NDArray[np.float64]


@dataclass(slots=True)
class Mesh:
    """A triangle mesh under construction.

    Attributes:
        points: (N, 3), m.
        faces: (T, 3).
        colours: sRGB, (N, 3).
        weights: of each bone, (N, B).
    """

    points: Array
    faces: Indices
    colours: Array
    weights: Array

    def normals(self) -> Array:
        """Return unit vertex normals, (N, 3)."""
        return vertex_normals(self.points, self.faces)


def piece(body: Body, quads: Indices, colour: Callable[[Array], Array], *, keep: int) -> Mesh:
    """Return a part of the body's mesh with about `keep` triangles at most."""
    used, faces = triangles(quads)
    points = body.vertices[used]
    weights = body.weights[used]
    if len(faces) > keep:
        small, faces = fast_simplification.simplify(
            points.astype(np.float32), faces.astype(np.int32), target_count=keep
        )
        nearest = _nearest(small.astype(float), points)
        points, weights = small.astype(float), weights[nearest]
    return Mesh(points, np.asarray(faces, np.intp), np.clip(colour(points), 0.0, 1.0), weights)


def rounded_box(half: Array, steps: int) -> tuple[Array, Indices]:
    """Return a box with soft edges: a sphere of a high norm."""
    u = np.linspace(-np.pi / 2, np.pi / 2, steps)
    v = np.linspace(-np.pi, np.pi, 2 * steps, endpoint=False)
    uu, vv = np.meshgrid(u, v, indexing="ij")

    def soft(x: Array) -> Array:
        return np.sign(x) * np.abs(x) ** 0.45

    points = np.stack(
        [soft(np.cos(uu)) * soft(np.sin(vv)), soft(np.sin(uu)), soft(np.cos(uu)) * soft(np.cos(vv))], axis=-1
    ).reshape(-1, 3)
    faces = []
    columns = 2 * steps
    for i in range(steps - 1):
        for j in range(columns):
            a, b = i * columns + j, i * columns + (j + 1) % columns
            c, d = a + columns, b + columns
            faces += [(a, b, d), (a, d, c)]
    return points * half, np.array(faces)


def joined(parts: list[Mesh]) -> Mesh:
    """Return the parts as one mesh."""
    offsets = np.cumsum([0, *(len(part.points) for part in parts)])
    return Mesh(
        np.concatenate([part.points for part in parts]),
        np.concatenate([part.faces + at for part, at in zip(parts, offsets, strict=False)]),
        np.concatenate([part.colours for part in parts]),
        np.concatenate([part.weights for part in parts]),
    )


def triangles(quads: Indices) -> tuple[Indices, Indices]:
    """Return the vertices that some quads use, and their triangles among those."""
    used, flat = np.unique(quads, return_inverse=True)
    four = flat.reshape(quads.shape)
    return used, np.concatenate([four[:, [0, 1, 2]], four[:, [0, 2, 3]]])


def _nearest(points: Array, among: Array) -> Indices:
    """Return the index in `among` of the nearest to each point."""
    result = np.empty(len(points), np.intp)
    for begin in range(0, len(points), 256):
        some = points[begin : begin + 256]
        result[begin : begin + 256] = ((some[:, None] - among) ** 2).sum(axis=2).argmin(axis=1)
    return result


def vertex_normals(points: Array, faces: Indices) -> Array:
    """Return unit vertex normals, (N, 3)."""
    a, b, c = (points[faces[:, k]] for k in range(3))
    across = np.cross(b - a, c - a)
    normals = np.zeros_like(points)
    for k in range(3):
        np.add.at(normals, faces[:, k], across)
    unit: Array = normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    return unit
