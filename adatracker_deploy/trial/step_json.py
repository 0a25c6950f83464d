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
from typing import TYPE_CHECKING, Any

from adatracker_deploy.messages import Box
from adatracker_deploy.trial.record import Latency, ScoredStep, StepRecord

if TYPE_CHECKING:
    from collections.abc import Callable

STEP_SCHEMA_NAME = "adatracker.Step"
STEP_FORMAT = 1
"""Raised when a field changes its meaning; fields may be added without."""

_SCORED = (b'"box":', b'"step":', b'"t_ns":', b'"missed_deadlines":', b'"distance_m":', b'"bearing_rad":')

_PLAIN = {bool: "boolean", int: "integer", float: "number", str: "string"}


def step_to_json(record: StepRecord) -> bytes:
    """Encode a record as UTF-8 JSON."""
    return json.dumps(_plain(record), allow_nan=False, separators=(",", ":")).encode()


def step_from_json(data: bytes) -> StepRecord:
    """Decode a record; fields that this version does not know are ignored.

    Raises:
        ValueError: it is not JSON, or a field is missing or of another type.
    """
    try:
        record: StepRecord = _builder(StepRecord)(json.loads(data))
    except (KeyError, TypeError, AttributeError) as error:
        raise ValueError(f"not a step record: {error}") from error
    return record


def scored_step_from_json(data: bytes) -> ScoredStep:
    """Decode as much of a record as scoring needs, without looking at the rest.

    Raises:
        ValueError: as `step_from_json`, for what is read.
    """
    try:
        value = json.loads(_without_the_middle(data).decode())  # told its encoding, it need not guess
        box = value.get("box")
        return ScoredStep(
            _whole(value["step"]),
            _whole(value["t_ns"]),
            box and Box(float(box["cx"]), float(box["cy"]), float(box["w"]), float(box["h"])),
            _builder(Latency)(value["latency"]),
            _whole(value["missed_deadlines"]),
            _number(value.get("distance_m")),
            _number(value.get("bearing_rad")),
        )
    except (KeyError, TypeError, AttributeError) as error:
        raise ValueError(f"not a step record: {error}") from error


def step_schema() -> bytes:
    """Return the JSON Schema of a step record; its descriptions are the fields' docstrings."""
    return json.dumps(
        {"title": STEP_SCHEMA_NAME, "$comment": f"format {STEP_FORMAT}"} | _schema(StepRecord)
    ).encode()


def _plain(value: Any) -> Any:
    if dataclasses.is_dataclass(value):
        named = ((field.name, getattr(value, field.name)) for field in dataclasses.fields(value))
        return {name: _plain(item) for name, item in named if item is not None}
    if isinstance(value, tuple):
        return [_plain(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return "NaN" if math.isnan(value) else "Infinity" if value > 0 else "-Infinity"
    return value


@functools.cache
def _builder(hint: Any) -> Callable[[Any], Any]:
    """Return what turns a JSON value into a value of this type; made once, for an hour has 72,000 steps."""
    hint, _ = _without_none(hint)
    if dataclasses.is_dataclass(hint) and isinstance(hint, type):
        fields = [(name, _without_none(item)[1], _builder(item)) for name, item in _hints(hint).items()]
        return lambda value: hint(
            **{
                name: None if optional and name not in value else build(value[name])
                for name, optional, build in fields
            }
        )
    if typing.get_origin(hint) is tuple:
        build_item = _builder(typing.get_args(hint)[0])
        return lambda value: tuple(map(build_item, value))
    if hint is float:
        return float

    def checked(value: Any) -> Any:
        if not isinstance(value, hint):
            raise TypeError(f"expected {hint.__name__}, got {value!r}")
        return value

    return checked


def _without_the_middle(data: bytes) -> bytes:
    """Cut out the fields between box and latency: they are most of a record, and none is scored.

    The bytes looked for cannot be part of a text, where JSON writes quotation marks escaped. A record whose
    fields are in another order than `step_to_json` writes them stays whole.
    """
    start, end = data.find(b',"confidence":'), data.find(b',"latency":')
    if not 0 < start < end or any(data.find(name, start, end) >= 0 for name in _SCORED):
        return data
    return data[:start] + data[end:]


def _whole(value: Any) -> int:
    if not isinstance(value, int):
        raise TypeError(f"expected int, got {value!r}")
    return value


def _number(value: Any) -> float | None:
    return None if value is None else float(value)


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
