"""The step record as JSON, with a JSON Schema that follows from the dataclass and cannot drift from it.

Missing values are left out rather than written as null, and numbers that JSON cannot hold are written as
the texts "NaN", "Infinity" and "-Infinity" (as protobuf's JSON mapping does): every field then has one plain
type, which is what log viewers can plot.
"""

from __future__ import annotations

import ast
import dataclasses
import functools
import inspect
import json
import math
import textwrap
import types
import typing
from typing import Any, TypeVar

import msgspec

from adatracker_deploy.core.record import ScoredStep, StepRecord

StepT = TypeVar("StepT", StepRecord, ScoredStep)

STEP_SCHEMA_NAME = "adatracker.Step"
STEP_FORMAT = 2
"""Raised when a field changes its meaning; fields may be added without. 2: `sent`, `gate` and the latencies
behind the gate are of the record's own tick; `stale` is said."""
OLDEST_FORMAT = 1
"""The oldest that is read; `older` says how."""

_STEP = msgspec.json.Decoder(StepRecord, strict=False)  # not strict: "NaN" is a number
_SCORED_STEP = msgspec.json.Decoder(ScoredStep, strict=False)

_PLAIN = {bool: "boolean", int: "integer", float: "number", str: "string"}


def step_to_json(record: StepRecord) -> bytes:
    """Encode a record as UTF-8 JSON."""
    return json.dumps(_plain(record), allow_nan=False, separators=(",", ":")).encode()


def step_from_json(data: bytes) -> StepRecord:
    """Decode a record; fields that this version does not know are ignored.

    Raises:
        ValueError: it is not JSON, or a field is missing or of another type.
    """
    return _decoded(_STEP, data)


def scored_step_from_json(data: bytes) -> ScoredStep:
    """Decode as much of a record as scoring needs, without making anything of the rest.

    Raises:
        ValueError: as `step_from_json`, for what is read.
    """
    return _decoded(_SCORED_STEP, data)


def step_schema() -> bytes:
    """Return the JSON Schema of a step record; its descriptions are the fields' docstrings."""
    return json.dumps(
        {"title": STEP_SCHEMA_NAME, "$comment": f"format {STEP_FORMAT}"} | _schema(StepRecord)
    ).encode()


def _plain(value: Any) -> Any:
    if isinstance(value, float):
        if math.isfinite(value):
            return value
        return "NaN" if math.isnan(value) else "Infinity" if value > 0 else "-Infinity"
    if isinstance(value, tuple):
        return [_plain(item) for item in value]
    names = _field_names(value.__class__)
    if not names:
        return value
    named = ((name, getattr(value, name)) for name in names)
    return {name: _plain(item) for name, item in named if item is not None}


@functools.cache
def _field_names(cls: type) -> tuple[str, ...]:
    """Return a dataclass's fields; nothing of another class."""
    return tuple(field.name for field in dataclasses.fields(cls)) if dataclasses.is_dataclass(cls) else ()


def _decoded(decoder: msgspec.json.Decoder[StepT], data: bytes) -> StepT:
    try:
        return decoder.decode(data)
    except msgspec.MsgspecError as error:
        raise ValueError(f"not a step record: {error}") from error


@functools.cache
def _hints(cls: type) -> dict[str, Any]:
    return typing.get_type_hints(cls)


def _without_none(hint: Any) -> tuple[Any, bool]:
    """Split an optional type into the type and whether it was optional."""
    if typing.get_origin(hint) in (typing.Union, types.UnionType):
        (inner,) = [arg for arg in typing.get_args(hint) if arg is not types.NoneType]
        return inner, True
    return hint, False


def _schema(hint: Any) -> dict[str, Any]:
    hint, _ = _without_none(hint)
    if dataclasses.is_dataclass(hint) and isinstance(hint, type):
        hints, docs = _hints(hint), _field_docs(hint)
        return {
            "type": "object",
            "description": inspect.getdoc(hint),
            "properties": {
                name: _schema(item) | ({"description": docs[name]} if name in docs else {})
                for name, item in hints.items()
            },
            "required": [name for name, item in hints.items() if not _without_none(item)[1]],
        }
    if typing.get_origin(hint) is tuple:
        return {"type": "array", "items": _schema(typing.get_args(hint)[0])}
    return {"type": _PLAIN[hint]}


def _field_docs(cls: type) -> dict[str, str]:
    """Return the docstrings written below a class's fields, which Python itself does not keep."""
    body = ast.parse(textwrap.dedent(inspect.getsource(cls))).body[0]
    assert isinstance(body, ast.ClassDef)
    return {
        field.target.id: doc.value.value
        for field, doc in zip(body.body, body.body[1:], strict=False)
        if isinstance(field, ast.AnnAssign)
        and isinstance(field.target, ast.Name)
        and isinstance(doc, ast.Expr)
        and isinstance(doc.value, ast.Constant)
        and isinstance(doc.value.value, str)
    }
