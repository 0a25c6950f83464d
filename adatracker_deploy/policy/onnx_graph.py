"""What an ONNX file may hold before a robot's computer runs it.

Plain ONNX operators only, all weights inside the file, and tensors exactly as the manifest states. The file
is walked as the protobuf message it is, so that nothing hides in a subgraph, a function or an attribute.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import onnx
from google.protobuf.message import DecodeError, Message

from adatracker_deploy.errors import UsageError
from adatracker_deploy.policy.manifest import GraphSpec, TensorSpec, check_tensors

_DTYPES = {onnx.TensorProto.FLOAT: "float32"}
_OWN_DOMAINS = ("", "ai.onnx")
"""Two spellings of ONNX's own operators."""


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
    try:
        model = onnx.load_model_from_string(data)
    except DecodeError as error:
        raise UsageError(f"{where}: is not an ONNX model: {error}") from error
    versions = [entry.version for entry in model.opset_import if entry.domain in _OWN_DOMAINS]
    if versions != [opset]:
        raise UsageError(f"{where}: uses opset {versions}, but the manifest says {opset}")
    if model.functions:
        raise UsageError(
            f"{where}: holds functions of its own ({model.functions[0].name}); export it inlined"
        )
    for part in _parts(model):
        if isinstance(part, onnx.TensorProto) and _is_outside(part):
            raise UsageError(f"{where}: keeps {part.name!r} as external data; export it as one file")
        if isinstance(part, onnx.NodeProto) and part.domain not in _OWN_DOMAINS:
            raise UsageError(f"{where}: uses the custom operator {part.domain}::{part.op_type}")
    check_tensors(_tensors(model.graph.input), spec.inputs, where=f"{where}: inputs")
    check_tensors(_tensors(model.graph.output), spec.outputs, where=f"{where}: outputs")


def _parts(message: Message) -> Iterator[Message]:
    """Yield a protobuf message and every message inside it, at any depth."""
    yield message
    for field, value in message.ListFields():
        if field.message_type is not None:
            for part in (value,) if isinstance(value, Message) else value:
                yield from _parts(part)


def _is_outside(tensor: Any) -> bool:
    return bool(tensor.data_location == onnx.TensorProto.EXTERNAL or tensor.external_data)


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
