"""The index of the models: what each file is, how to know it again, how it was made."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Any

import onnx
import yaml

from perception_conversion import package
from perception_conversion.catalogue import Source

HEAD = "# Written by tools/convert_perception.py. NOTICE says whose work the models are.\n"


def digest(path: Path) -> str:
    """Return a file's SHA-256."""
    return hashlib.sha256(path.read_bytes()).hexdigest()


def entry(source: Source, folder: Path, made: dict[str, str]) -> dict[str, Any]:
    """Return what the index says of a model; `made` tells of each of its files how it was made."""
    files = {
        name: {"sha256": digest(folder / name), "bytes": (folder / name).stat().st_size, "made": how}
        for name, how in made.items()
    }
    graph = onnx.load(folder / next(iter(made))).graph
    about = dict(source.about)
    told = {key: about.pop(key) for key in ("what", "upstream", "licence")}
    return told | {"files": files, "inputs": _tensors(graph.input), "outputs": _tensors(graph.output)} | about


def text(models: dict[str, dict[str, Any]]) -> str:
    """Return the index as YAML."""
    source = {"npm": package.NAME, "version": package.VERSION, "sha256": package.SHA256, "licence": "MIT"}
    tree = {"package": source, "models": models}
    return HEAD + yaml.safe_dump(
        tree, sort_keys=False, width=110, allow_unicode=True, default_flow_style=None
    )


def _tensors(values: Any) -> dict[str, dict[str, Any]]:
    return {
        value.name: {
            "dtype": onnx.helper.tensor_dtype_to_np_dtype(value.type.tensor_type.elem_type).name,
            "shape": [axis.dim_param or axis.dim_value for axis in value.type.tensor_type.shape.dim],
        }
        for value in values
    }
