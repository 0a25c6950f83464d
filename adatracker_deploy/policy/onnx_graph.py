"""Checks a bundle's ONNX graph against its manifest before it is run.

Plain ONNX operators only, all weights inside the file (`onnx_file`), and tensors exactly as the manifest
states.
"""

from __future__ import annotations

from typing import Any

import onnx

from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.core.onnx_file import check_plain, opsets, read_model
from adatracker_deploy.policy.manifest import GraphSpec, TensorSpec, check_tensors

_DTYPES = {onnx.TensorProto.FLOAT: "float32"}


def check_graph(data: bytes, spec: GraphSpec, opset: int, *, where: str) -> None:
    """Refuse a model that is not what the manifest says, or that reaches outside itself.

    Args:
        data: the file's bytes.
        spec: its inputs and outputs, by the manifest.
        opset: its opset, by the manifest.
        where: the file's path, for errors.

    Raises:
        UsageError: one line that names the file and the reason.
    """
    model = read_model(data, where=where)
    versions = opsets(model)
    if versions != [opset]:
        raise UsageError(f"{where}: uses opset {versions}, but the manifest says {opset}")
    check_plain(model, where=where)
    check_tensors(_tensors(model.graph.input), spec.inputs, where=f"{where}: inputs")
    check_tensors(_tensors(model.graph.output), spec.outputs, where=f"{where}: outputs")


def _tensors(values: Any) -> tuple[TensorSpec, ...]:
    """Read the declared tensors; a dimension without a number reads as -1, which fits no manifest."""
    return tuple(
        TensorSpec(
            name=value.name,
            shape=tuple(
                dim.dim_value if dim.HasField("dim_value") else -1 for dim in value.type.tensor_type.shape.dim
            ),
            dtype=_DTYPES.get(value.type.tensor_type.elem_type, "another dtype"),  # type: ignore[arg-type]
        )
        for value in values
    )
