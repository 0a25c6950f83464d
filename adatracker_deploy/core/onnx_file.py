"""What an ONNX file may hold before a robot's computer runs it: plain operators, no loop, all weights inside.

The file is walked as the protobuf message it is, so that nothing hides in a subgraph, a function or an
attribute.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import onnx
from google.protobuf.message import DecodeError, Message

from adatracker_deploy.core.errors import UsageError

OWN_DOMAINS = ("", "ai.onnx")
"""Two spellings of ONNX's own operators."""
ENDLESS = frozenset({"Loop", "Scan", "SequenceMap"})
"""Operators that run a graph of their own again and again: a Loop without a trip count for ever, Scans in
Scans nearly so. No shipped network and none of the toolkit's exports has one; what has a fixed length can be
unrolled."""
RUNTIME_DOMAINS = (*OWN_DOMAINS, "com.microsoft")
"""And those that every onnxruntime carries besides: its quantiser and its optimiser write them."""


def read_model(data: bytes, *, where: str) -> Any:
    """Return the ONNX ModelProto of a file's bytes; nothing of it is checked yet.

    Raises:
        UsageError: the bytes are no ONNX model.
    """
    try:
        model = onnx.load_model_from_string(data)
    except DecodeError as error:
        raise UsageError(f"{where}: is not an ONNX model: {error}") from error
    return model


def opsets(model: Any) -> list[int]:
    """Return the versions of ONNX's own operators that a model states: one, if it is sound."""
    return [entry.version for entry in model.opset_import if entry.domain in OWN_DOMAINS]


def check_plain(
    model: Any, *, where: str, domains: tuple[str, ...] = OWN_DOMAINS, outside: bool = False
) -> set[str]:
    """Refuse a model that needs more than its own file and an ordinary runtime.

    Args:
        model: a ModelProto.
        where: the file's path, for errors.
        domains: whose operators it may use.
        outside: whether it may keep weights in other files.

    Returns:
        The names of the other files, as the model writes them.

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
