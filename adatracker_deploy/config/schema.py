"""Typed settings from plain mappings: unknown keys, wrong types and values out of range are refused.

A settings class is a frozen dataclass; a field without a default is required; a number is bounded by
``Annotated[float, Range(0, 5)]``. All profiles and bundle manifests are read through this module.
"""

from __future__ import annotations

import dataclasses
import difflib
import math
import reprlib
import types
import typing
from collections.abc import Mapping
from typing import Any, TypeVar

from adatracker_deploy.core.errors import UsageError

T = TypeVar("T")


@dataclasses.dataclass(frozen=True, slots=True)
class Range:
    """Inclusive bounds of a number."""

    low: float
    high: float


def parse(cls: type[T], value: Any, *, where: str) -> T:
    """Build `cls` from a mapping as ``yaml.safe_load`` gives it.

    Args:
        cls: a dataclass; fields may be bool, int, float, str, Literal, unions (the first kind that fits is
            taken), optionals, tuples, str-keyed dicts, nested dataclasses, and Annotated numbers.
        value: the mapping.
        where: names the source in errors, for example the file's path.

    Raises:
        UsageError: one line that names the source, the key and the reason.
    """
    if not isinstance(value, Mapping):
        raise UsageError(f"{where}: expected a mapping, got {_named(value)}")
    hints = typing.get_type_hints(cls, include_extras=True)
    fields = {field.name: field for field in dataclasses.fields(cls) if field.init}  # type: ignore[arg-type]
    for key in value:
        if key not in fields:
            near = difflib.get_close_matches(str(key), fields, n=1)
            hint = f"did you mean {near[0]!r}?" if near else f"known keys are {', '.join(fields)}"
            raise UsageError(f"{where}: unknown key {key!r}; {hint}")
    made: dict[str, Any] = {}
    for name, field in fields.items():
        if name in value:
            made[name] = _convert(hints[name], value[name], f"{where}: {name}")
        elif field.default is dataclasses.MISSING and field.default_factory is dataclasses.MISSING:
            raise UsageError(f"{where}: missing key {name!r}")
    return cls(**made)


def _named(value: Any) -> str:
    """Describe a value by its type and its shortened text."""
    return "nothing" if value is None else f"{type(value).__name__} {reprlib.repr(value)}"


def _convert(hint: Any, value: Any, where: str) -> Any:
    bounds: tuple[Range, ...] = ()
    if typing.get_origin(hint) is typing.Annotated:
        hint, *marks = typing.get_args(hint)
        bounds = tuple(mark for mark in marks if isinstance(mark, Range))
    if hint is Any:
        return value
    origin, args = typing.get_origin(hint), typing.get_args(hint)
    if origin in (typing.Union, types.UnionType):
        return _union(args, bounds, value, where)
    if origin in _GENERIC:
        return _GENERIC[origin](args, value, where)
    if dataclasses.is_dataclass(hint) and isinstance(hint, type):
        return parse(hint, value, where=where)
    return _scalar(hint, bounds, value, where)


def _union(args: tuple[Any, ...], bounds: tuple[Range, ...], value: Any, where: str) -> Any:
    if value is None and type(None) in args:
        return None
    reasons = []
    for inner in (arg for arg in args if arg is not type(None)):
        try:
            return _convert(typing.Annotated[inner, *bounds] if bounds else inner, value, where)
        except UsageError as error:
            reasons.append(str(error).removeprefix(where).removeprefix(": "))
    raise UsageError(f"{where}: {'; or '.join(reasons)}")


def _tuple(args: tuple[Any, ...], value: Any, where: str) -> tuple[Any, ...]:
    if not isinstance(value, list | tuple):
        raise UsageError(f"{where}: expected a list, got {_named(value)}")
    if len(args) == 2 and args[1] is Ellipsis:
        args = (args[0],) * len(value)
    if len(value) != len(args):
        raise UsageError(f"{where}: expected {len(args)} values, got {len(value)}")
    return tuple(
        _convert(arg, item, f"{where}[{i}]") for i, (arg, item) in enumerate(zip(args, value, strict=True))
    )


def _dict(args: tuple[Any, ...], value: Any, where: str) -> dict[str, Any]:
    if not isinstance(value, Mapping) or not all(isinstance(key, str) for key in value):
        raise UsageError(f"{where}: expected a mapping with text keys, got {_named(value)}")
    return {key: _convert(args[1], item, f"{where}.{key}") for key, item in value.items()}


def _literal(args: tuple[Any, ...], value: Any, where: str) -> Any:
    if value not in args or isinstance(value, bool) is not isinstance(args[0], bool):
        raise UsageError(f"{where}: expected one of {', '.join(map(repr, args))}, got {_named(value)}")
    return value


_GENERIC = {tuple: _tuple, dict: _dict, typing.Literal: _literal}
_KINDS = {bool: "true or false", int: "a whole number", float: "a number", str: "text"}


def _scalar(hint: Any, bounds: tuple[Range, ...], value: Any, where: str) -> Any:
    if hint not in _KINDS:
        raise TypeError(f"{where}: settings cannot hold {hint!r}")
    accepted = (int, float) if hint is float else hint
    if not isinstance(value, accepted) or (isinstance(value, bool) and hint is not bool):
        raise UsageError(f"{where}: expected {_KINDS[hint]}, got {_named(value)}")
    if hint is float:
        value = float(value)
        if not math.isfinite(value):
            raise UsageError(f"{where}: expected a finite number, got {value}")
    for bound in bounds:
        if not bound.low <= value <= bound.high:
            raise UsageError(f"{where}: {value} is out of range [{bound.low:g}, {bound.high:g}]")
    return value
