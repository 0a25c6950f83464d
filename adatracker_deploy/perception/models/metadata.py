"""Reads the metadata that Ultralytics' exporter writes into a file; they take precedence over its name.

Keys and their spelling are those of `ultralytics/engine/exporter.py`: every value is the text of a Python
literal.
"""

from __future__ import annotations

import ast
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from adatracker_deploy.core.errors import UsageError

_CAP_CHARS = 1 << 20


@dataclass(frozen=True, slots=True, kw_only=True)
class Metadata:
    """The part that decides how a YOLO file is used."""

    task: str
    names: dict[int, str]
    size: tuple[int, int] | None
    """Rows and columns of the input."""
    stride: int
    finished: bool
    """Whether it gives the final boxes (`end2end`, or exported with `nms`), not a head to be decoded."""


def read_metadata(entries: Mapping[str, str], *, where: str) -> Metadata | None:
    """Return what a file says of itself; None where it is not Ultralytics' doing.

    Raises:
        UsageError: it says it in a way that cannot be read.
    """
    if "task" not in entries or "names" not in entries:
        return None
    names = _literal(entries, "names", where)
    if isinstance(names, list | tuple):
        names = dict(enumerate(names))
    if not isinstance(names, dict) or not all(
        isinstance(key, int) and isinstance(name, str) for key, name in names.items()
    ):
        raise UsageError(f"{where}: metadata: names: expected a number and a name for each class")
    size = _literal(entries, "imgsz", where)
    args = _literal(entries, "args", where)
    stride = _literal(entries, "stride", where)
    return Metadata(
        task=entries["task"],
        names=names,
        size=_size(size, where),
        stride=stride if isinstance(stride, int) and stride > 0 else 1,
        finished=_literal(entries, "end2end", where) is True
        or (isinstance(args, dict) and args.get("nms") is True)
        or _literal(entries, "nms", where) is True,
    )


def _size(value: Any, where: str) -> tuple[int, int] | None:
    if value is None:
        return None
    if isinstance(value, int):
        return value, value
    if isinstance(value, list | tuple) and len(value) == 2 and all(isinstance(side, int) for side in value):
        return value[0], value[1]
    raise UsageError(f"{where}: metadata: imgsz: expected rows and columns, got {value!r}")


def _literal(entries: Mapping[str, str], key: str, where: str) -> Any:
    """Read one value; never run it."""
    text = entries.get(key, "None")
    try:
        if len(text) > _CAP_CHARS:
            raise ValueError("too long")
        return ast.literal_eval(text)
    except (ValueError, SyntaxError, RecursionError, MemoryError) as error:
        raise UsageError(f"{where}: metadata: {key}: cannot be read: {text[:80]!r}") from error
