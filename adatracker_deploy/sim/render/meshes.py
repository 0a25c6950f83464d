"""Triangle meshes of a scene's primitives and ground, with normals and texture coordinates. Pure."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from adatracker_deploy.sim.scene import Part
from adatracker_deploy.sim.terrain import Terrain

Array = NDArray[np.float64]

TEXTURE_M = 2.4
"""Metres of a surface that a texture covers before it repeats."""
STOREY_M = 3.0
_ROUND = 20
"""Corners of a circle."""


@dataclass(frozen=True, slots=True)
class Mesh:
    """Triangles with a normal and texture coordinates for each vertex.

    Attributes:
        points: m, (N, 3).
        normals: unit, (N, 3).
        uv: (N, 2).
        faces: counter-clockwise from outside, (T, 3).
    """

    points: Array
    normals: Array
    uv: Array
    faces: NDArray[np.intp]


def of_part(part: Part) -> Mesh:
    """Return a primitive's mesh in its thing's frame."""
    if part.shape == "box":
        mesh = box(part.half, STOREY_M if part.windows else TEXTURE_M)
    elif part.shape == "cylinder":
        mesh = _cylinder(part.half[0], part.half[2])
    else:
        mesh = _ellipsoid(part.half)
    return Mesh(mesh.points + part.at, mesh.normals, mesh.uv, mesh.faces)


def joined(parts: Sequence[Mesh]) -> Mesh:
    """Return several meshes, one at least, as one."""
    before = np.cumsum([0, *(len(part.points) for part in parts[:-1])])
    return Mesh(
        np.concatenate([part.points for part in parts]),
        np.concatenate([part.normals for part in parts]),
        np.concatenate([part.uv for part in parts]),
        np.concatenate([part.faces + first for part, first in zip(parts, before, strict=True)]),
    )


def box(half: tuple[float, float, float], tall_m: float = TEXTURE_M) -> Mesh:
    """Return a box around the origin; its texture is upright on the sides, `tall_m` high."""
    points: list[Array] = []
    normals: list[Array] = []
    uv: list[Array] = []
    faces: list[list[int]] = []
    size = 2 * np.array(half)
    for axis in range(3):
        for sign in (-1.0, 1.0):
            u, v = (axis + 1) % 3, (axis + 2) % 3
            if v != 2 and axis != 2:  # the vertical is the texture's v on the sides
                u, v = v, u
            normal = np.zeros(3)
            normal[axis] = sign
            corners = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)], float)
            face = np.zeros((4, 3))
            face[:, axis] = sign * half[axis]
            face[:, u], face[:, v] = corners[:, 0] * half[u], corners[:, 1] * half[v]
            order = [0, 1, 2, 3]
            if np.cross(face[1] - face[0], face[2] - face[0]) @ normal < 0:
                order = [0, 3, 2, 1]
            first = 4 * len(points)
            points.append(face)
            normals.append(np.tile(normal, (4, 1)))
            across = TEXTURE_M
            uv.append((corners + 1) / 2 * (size[u] / across, size[v] / (tall_m if axis != 2 else across)))
            faces += [[first + order[k] for k in (0, 1, 2)], [first + order[k] for k in (0, 2, 3)]]
    return Mesh(np.concatenate(points), np.concatenate(normals), np.concatenate(uv), np.array(faces))


def _cylinder(radius: float, half_z: float) -> Mesh:
    angles = np.linspace(0.0, 2 * np.pi, _ROUND + 1)
    circle = np.stack([np.cos(angles), np.sin(angles), np.zeros_like(angles)], axis=1)
    side = [circle * radius + (0, 0, z) for z in (-half_z, half_z)]
    length = angles * radius / TEXTURE_M
    uv = [np.stack([length, np.full_like(length, z / TEXTURE_M)], axis=1) for z in (0.0, 2 * half_z)]
    count = _ROUND + 1
    faces = [
        face for k in range(_ROUND) for face in ((k, k + 1, count + k + 1), (k, count + k + 1, count + k))
    ]
    top = np.concatenate([[(0.0, 0.0, half_z)], side[1]])
    first = 2 * count
    faces += [(first, first + 1 + k, first + 2 + k) for k in range(_ROUND)]
    points = np.concatenate([*side, top])
    normals = np.concatenate([circle, circle, np.tile((0.0, 0.0, 1.0), (len(top), 1))])
    flat = top[:, :2] / TEXTURE_M
    return Mesh(points, normals, np.concatenate([*uv, flat]), np.array(faces))


def _ellipsoid(half: tuple[float, float, float]) -> Mesh:
    rows, columns = 11, _ROUND + 1
    v, u = np.meshgrid(
        np.linspace(-np.pi / 2, np.pi / 2, rows), np.linspace(0, 2 * np.pi, columns), indexing="ij"
    )
    unit = np.stack([np.cos(v) * np.cos(u), np.cos(v) * np.sin(u), np.sin(v)], axis=-1).reshape(-1, 3)
    normals = unit / np.array(half)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    uv = np.stack([u * max(half[:2]) / TEXTURE_M, (v + np.pi / 2) * half[2] / TEXTURE_M], axis=-1).reshape(
        -1, 2
    )
    faces = []
    for i in range(rows - 1):
        for j in range(columns - 1):
            a, b = i * columns + j, i * columns + j + 1
            faces += [(a, b, b + columns), (a, b + columns, a + columns)]
    return Mesh(unit * half, normals, uv, np.array(faces))


def ground(terrain: Terrain, repeat_m: float, reach_m: float = 160.0) -> Mesh:
    """Return the ground: the terrain's own triangles, or flat squares, and a flat apron out to the horizon.

    Args:
        terrain: the scene's.
        repeat_m: metres that the texture covers.
        reach_m: how far the apron goes.
    """
    if terrain.is_flat:
        at = np.linspace(-reach_m, reach_m, 33)  # many squares: light and texture vary little within each
        heights = np.zeros((33, 33))
    else:
        inner = np.linspace(-terrain.half_m, terrain.half_m, len(terrain.heights))
        at = np.concatenate([[-reach_m], inner, [reach_m]])
        heights = np.pad(terrain.heights, 1, mode="edge")
    x, y = np.meshgrid(at, at)
    points = np.stack([x, y, heights], axis=-1).reshape(-1, 3)
    slope_y, slope_x = np.gradient(heights, at, at)
    normals = np.stack([-slope_x, -slope_y, np.ones_like(heights)], axis=-1).reshape(-1, 3)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    n = len(at)
    corner = (np.arange(n - 1)[:, None] * n + np.arange(n - 1)).reshape(-1)
    # Each cell is split along the diagonal from its corner at low x and low y, as the terrain's heights are.
    faces = np.concatenate(
        [
            np.stack([corner, corner + 1, corner + n + 1], axis=1),
            np.stack([corner, corner + n + 1, corner + n], axis=1),
        ]
    )
    return Mesh(points, normals, points[:, :2] / repeat_m, faces)
