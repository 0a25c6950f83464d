"""TensorFlow.js models of a few operations, written as their exporter writes them."""

from __future__ import annotations

import base64
import json
from dataclasses import dataclass, field

import numpy as np


@dataclass
class TinyModel:
    """A model under construction; `files` returns its `model.json` and its weights."""

    nodes: list[dict] = field(default_factory=list)
    weights: list[dict] = field(default_factory=list)
    stored: list[bytes] = field(default_factory=list)

    def input(self, name: str, *shape: int) -> str:
        dims = {"shape": {"dim": [{"size": str(size)} for size in shape]}}
        self.nodes.append({"name": name, "op": "Placeholder", "attr": {"shape": dims}})
        return name

    def constant(self, name: str, array, half: bool = False) -> str:
        array = np.asarray(array)
        entry = {"name": name, "shape": list(array.shape), "dtype": array.dtype.name}
        if half:
            entry["quantization"] = {"dtype": "float16", "original_dtype": "float32"}
        self.nodes.append({"name": name, "op": "Const"})
        self.weights.append(entry)
        self.stored.append(array.astype(np.float16 if half else array.dtype).tobytes())
        return name

    def add(self, op: str, name: str, *inputs: str, **attributes) -> str:
        attr = {key: encoded(value) for key, value in attributes.items()}
        self.nodes.append({"name": name, "op": op, "input": list(inputs), "attr": attr})
        return name

    def files(self) -> tuple[bytes, bytes]:
        tree = {
            "modelTopology": {"node": self.nodes},
            "weightsManifest": [{"paths": ["model.bin"], "weights": self.weights}],
        }
        return json.dumps(tree).encode(), b"".join(self.stored)


def encoded(value) -> dict:
    match value:
        case bool():
            return {"b": value}
        case float():
            return {"f": value}
        case str():
            return {"s": base64.b64encode(value.encode()).decode()}
        case [str(), *_]:
            return {"list": {"s": [encoded(item)["s"] for item in value]}}
        case _:
            return {"list": {"i": [str(item) for item in value]}}
