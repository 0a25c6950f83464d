"""Checks an ONNX file before it is run: plain operators, no loops, all weights inside.

The whole protobuf message is walked, so nothing can hide in a subgraph, a function or an attribute.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import onnx
from google.protobuf.message import DecodeError, Message

from adatracker_deploy.core.errors import UsageError, line_of

OWN_DOMAINS = ("", "ai.onnx")
"""The two spellings of ONNX's own operator domain."""
ENDLESS = frozenset({"Loop", "Scan", "SequenceMap"})
"""Operators that repeat a subgraph: a Loop without a trip count never ends, nested Scans hardly do. No
shipped network and no export of the toolkit has one; a loop of fixed length can be unrolled."""
RUNTIME_DOMAINS = (*OWN_DOMAINS, "com.microsoft")
"""`OWN_DOMAINS` and those built into every onnxruntime, which its quantiser and optimiser write."""


def read_model(data: bytes, *, where: str) -> Any:
    """Parse a file's bytes as an ONNX ModelProto; checks nothing else.

    Raises:
        UsageError: the bytes are not an ONNX model.
    """
    try:
        model = onnx.load_model_from_string(data)
    except DecodeError as error:
        raise UsageError(f"{where}: is not an ONNX model: {line_of(error)}") from error
    return model


def opsets(model: Any) -> list[int]:
    """Return the opset versions of ONNX's own operators that a model states; a valid model states one."""
    return [entry.version for entry in model.opset_import if entry.domain in OWN_DOMAINS]


def check_plain(
    model: Any, *, where: str, domains: tuple[str, ...] = OWN_DOMAINS, outside: bool = False
) -> set[str]:
    """Refuse a model that needs more than its own file and a standard runtime.

    Args:
        model: a ModelProto.
        where: the file's path, for errors.
        domains: operator domains that it may use.
        outside: whether its weights may be in other files.

    Returns:
        The names of those files, as written in the model.

    Raises:
        UsageError: one line that names the file and the reason.
    """
    if model.functions:
        raise UsageError(
            f"{where}: holds functions of its own ({model.functions[0].name}); export it inlined"
        )
    files: set[str] = set()
    for part in _parts(model):
        if isinstance(part, onnx.TensorProto) and _is_outside(part):
            if not outside:
                raise UsageError(f"{where}: keeps {part.name!r} as external data; export it as one file")
            files.update(entry.value for entry in part.external_data if entry.key == "location")
        if isinstance(part, onnx.NodeProto) and part.domain not in domains:
            raise UsageError(f"{where}: uses the custom operator {part.domain}::{part.op_type}")
        if isinstance(part, onnx.NodeProto) and part.op_type in ENDLESS:
            raise UsageError(
                f"{where}: holds a loop ({part.op_type}), which may never end; export it unrolled, from "
                "fixed shapes"
            )
    return files


def _parts(message: Message) -> Iterator[Message]:
    """Yield a protobuf message and every message inside it, at any depth."""
    yield message
    for field, value in message.ListFields():
        if field.message_type is not None:
            for part in (value,) if isinstance(value, Message) else value:
                yield from _parts(part)


def _is_outside(tensor: Any) -> bool:
    return bool(tensor.data_location == onnx.TensorProto.EXTERNAL or tensor.external_data)
