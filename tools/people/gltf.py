"""Writes a person as binary glTF 2.0 (Khronos specification): one skinned mesh with vertex colours."""

from __future__ import annotations

import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from people.base_mesh import Body
from people.mesh import Mesh
from people.motion import Motion

_FLOAT, _U8, _U16, _U32 = 5126, 5121, 5123, 5125
_VERTICES, _INDICES = 34962, 34963
_KINDS = {np.dtype(np.float32): _FLOAT, np.dtype(np.uint8): _U8, np.dtype(np.uint16): _U16}
_SHAPES = {(): "SCALAR", (3,): "VEC3", (4,): "VEC4", (4, 4): "MAT4"}


class _Buffer:
    """Collects arrays, each behind an accessor."""

    def __init__(self) -> None:
        self.bytes = bytearray()
        self.views: list[dict[str, Any]] = []
        self.accessors: list[dict[str, Any]] = []

    def add(
        self, array: NDArray[Any], *, target: int = 0, normalized: bool = False, bounds: bool = False
    ) -> int:
        """Append an array; return its accessor's index."""
        self.bytes += b"\0" * (-len(self.bytes) % 4)
        view = {"buffer": 0, "byteOffset": len(self.bytes), "byteLength": array.nbytes}
        if target:
            view["target"] = target
        self.bytes += np.ascontiguousarray(array).tobytes()
        accessor: dict[str, Any] = {
            "bufferView": len(self.views),
            "componentType": _KINDS[array.dtype],
            "count": len(array),
            "type": _SHAPES[array.shape[1:]],
        }
        if normalized:
            accessor["normalized"] = True
        if bounds:
            accessor["min"] = np.atleast_1d(array.min(axis=0)).tolist()
            accessor["max"] = np.atleast_1d(array.max(axis=0)).tolist()
        self.views.append(view)
        self.accessors.append(accessor)
        return len(self.accessors) - 1


def write(path: Path, body: Body, mesh: Mesh, motions: dict[str, Motion], *, name: str, rights: str) -> None:
    """Write somebody with their animations.

    Args:
        path: the .glb.
        body: has the bones.
        mesh: in rest pose.
        motions: by name.
        name: the person's.
        rights: for the file's own header.
    """
    buffer = _Buffer()
    joints, weights = _four_strongest(mesh.weights)
    linear = np.where(mesh.colours <= 0.04045, mesh.colours / 12.92, ((mesh.colours + 0.055) / 1.055) ** 2.4)
    rgba = np.ones((len(linear), 4))
    rgba[:, :3] = linear
    primitive = {
        "attributes": {
            "POSITION": buffer.add(mesh.points.astype(np.float32), target=_VERTICES, bounds=True),
            "NORMAL": buffer.add(mesh.normals().astype(np.float32), target=_VERTICES),
            "COLOR_0": buffer.add(
                np.round(rgba * 65535).astype(np.uint16), target=_VERTICES, normalized=True
            ),
            "JOINTS_0": buffer.add(joints.astype(np.uint8), target=_VERTICES),
            "WEIGHTS_0": buffer.add(weights.astype(np.uint8), target=_VERTICES, normalized=True),
        },
        "indices": buffer.add(mesh.faces.reshape(-1).astype(np.uint16), target=_INDICES),
        "material": 0,
    }
    count = len(body.bones)
    inverse = np.tile(np.eye(4, dtype=np.float32), (count, 1, 1))
    inverse[:, 3, :3] = [-bone.head for bone in body.bones]  # column-major: the last row here is the column
    document = {
        "asset": {"version": "2.0", "generator": "adatracker-deploy make_people", "copyright": rights},
        "scene": 0,
        "scenes": [{"nodes": [count + 1]}],
        "nodes": [
            *_bone_nodes(body),
            {"name": f"{name}'s skin", "mesh": 0, "skin": 0},
            {"name": name, "children": [0, count]},
        ],
        "meshes": [{"name": name, "primitives": [primitive]}],
        "materials": [
            {
                "name": "cloth",
                "pbrMetallicRoughness": {"metallicFactor": 0.0, "roughnessFactor": 0.9},
                "doubleSided": True,
            }
        ],
        "skins": [{"joints": list(range(count)), "skeleton": 0, "inverseBindMatrices": buffer.add(inverse)}],
        "animations": [_animation(buffer, title, motion, body) for title, motion in motions.items()],
        "accessors": buffer.accessors,
        "bufferViews": buffer.views,
        "buffers": [{"byteLength": len(buffer.bytes) + -len(buffer.bytes) % 4}],
    }
    text = json.dumps(document, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    binary = bytes(buffer.bytes) + b"\0" * (-len(buffer.bytes) % 4)
    whole = 12 + 8 + len(text) + 8 + len(binary)
    path.write_bytes(
        struct.pack("<4sII", b"glTF", 2, whole)
        + struct.pack("<I4s", len(text), b"JSON")
        + text
        + struct.pack("<I4s", len(binary), b"BIN\0")
        + binary
    )


def _bone_nodes(body: Body) -> list[dict[str, Any]]:
    nodes = []
    for bone in body.bones:
        parent = body.bone(bone.parent).head if bone.parent else np.zeros(3)
        children = [body.place[other.name] for other in body.bones if other.parent == bone.name]
        node: dict[str, Any] = {"name": bone.name, "translation": (bone.head - parent).round(5).tolist()}
        if children:
            node["children"] = children
        nodes.append(node)
    return nodes


def _animation(buffer: _Buffer, title: str, motion: Motion, body: Body) -> dict[str, Any]:
    times = buffer.add(motion.seconds.astype(np.float32), bounds=True)
    root = body.bones[0].head + motion.shift
    outputs = [("translation", 0, buffer.add(root.astype(np.float32)))]
    outputs += [
        ("rotation", at, buffer.add(motion.turns[:, at].astype(np.float32)))
        for at in range(len(body.bones))
        if np.abs(motion.turns[:, at, :3]).max() > 1e-6
    ]
    return {
        "name": title,
        "samplers": [
            {"input": times, "output": output, "interpolation": "LINEAR"} for _, _, output in outputs
        ],
        "channels": [
            {"sampler": at, "target": {"node": node, "path": path}}
            for at, (path, node, _) in enumerate(outputs)
        ],
    }


def _four_strongest(weights: NDArray[np.float64]) -> tuple[NDArray[np.intp], NDArray[np.int64]]:
    """Return each vertex's four strongest bones, and their weights in 255ths that add up to 255."""
    joints = np.argsort(-weights, axis=1)[:, :4]
    strongest = np.take_along_axis(weights, joints, axis=1)
    shares = np.floor(255 * strongest / strongest.sum(axis=1, keepdims=True)).astype(np.int64)
    shares[:, 0] += 255 - shares.sum(axis=1)
    joints[shares == 0] = 0
    return joints, shares
