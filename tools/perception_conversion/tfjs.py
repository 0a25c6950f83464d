"""TensorFlow.js graph models as they lie on disk: `model.json` and the weights beside it."""

from __future__ import annotations

import base64
import json
import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]


@dataclass(frozen=True, slots=True)
class Node:
    """One operation of TensorFlow's."""

    name: str
    op: str
    inputs: tuple[str, ...]
    """Names of nodes, with ``:k`` for an output other than the first."""
    attributes: dict[str, Any]
    """As Python values; what is missing has TensorFlow's default."""


@dataclass(frozen=True, slots=True)
class Graph:
    """Operations in an order in which they can run, and the constants they use by name."""

    nodes: tuple[Node, ...]
    constants: dict[str, Array]


def read(model: bytes, weights: bytes) -> Graph:
    """Return the graph of `model.json` and its one weights file, floats as float32.

    Raises:
        ValueError: weights are of a kind that is not read here, or too many or too few for the graph.
    """
    tree = json.loads(model)
    constants: dict[str, Array] = {}
    offset = 0
    for group in tree["weightsManifest"]:
        for entry in group["weights"]:
            stored = _stored_dtype(entry)
            count = math.prod(entry["shape"])
            if offset + count * stored.itemsize > len(weights):
                raise ValueError(f"weights end before {entry['name']}")
            array = np.frombuffer(weights, stored, count, offset).reshape(entry["shape"])
            offset += array.nbytes
            constants[entry["name"]] = array.astype(entry["dtype"])
    if offset != len(weights):
        raise ValueError(f"weights have {len(weights)} bytes, the graph describes {offset}")
    nodes = tuple(_node(entry) for entry in tree["modelTopology"]["node"] if entry["op"] != "Const")
    return Graph(nodes, constants)


def _stored_dtype(entry: dict[str, Any]) -> np.dtype[Any]:
    how = entry.get("quantization")
    if how is None:
        plain: np.dtype[Any] = np.dtype(entry["dtype"])
        return plain.newbyteorder("<")
    if how["dtype"] != "float16":  # integers would need their scale, too
        raise ValueError(f"{entry['name']}: weights quantised to {how['dtype']} are not read here")
    return np.dtype("<f2")


def _node(entry: dict[str, Any]) -> Node:
    attributes = {key: _attribute(value) for key, value in entry.get("attr", {}).items()}
    # A name that begins with ^ only orders execution.
    inputs = tuple(name.removesuffix(":0") for name in entry.get("input", ()) if not name.startswith("^"))
    return Node(entry["name"], entry["op"], inputs, attributes)


def _attribute(value: dict[str, Any]) -> Any:
    """Return what protobuf's JSON says: 64-bit integers are strings there, bytes are base64."""
    ((kind, content),) = value.items()
    match kind:
        case "i":
            return int(content)
        case "s":
            return base64.b64decode(content).decode()
        case "list":
            return [_attribute({key: item}) for key, items in content.items() for item in items]
        case "shape":
            return tuple(int(axis["size"]) for axis in content.get("dim", ()))
        case _:
            return content
