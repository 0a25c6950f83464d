"""Reads strict YAML: plain values, each written out once. `schema` then checks them.

Three things that YAML allows are refused. An alias can make a small file stand for more values than fit in
memory; deep nesting overflows the stack; with a duplicate key, a person reads one value and the program uses
the other.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import yaml

from adatracker_deploy.core.errors import UsageError, line_of

if TYPE_CHECKING:
    from collections.abc import Hashable
    from pathlib import Path

CAP_BYTES = 1 << 20
DEEPEST = 32

_Loader: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
"""The C loader with the same rules, if PyYAML was built with it."""


class _StrictLoader(_Loader):  # type: ignore[misc]
    """A safe loader that refuses duplicate keys."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Hashable, Any]:
        seen = set()
        for key, _ in node.value:
            if isinstance(key, yaml.ScalarNode):
                if (key.tag, key.value) in seen:
                    raise _refusal(f"the key {key.value!r} is given twice", key.start_mark)
                seen.add((key.tag, key.value))
        made: dict[Hashable, Any] = super().construct_mapping(node, deep)
        return made


def read_yaml(path: Path, *, cap_bytes: int = CAP_BYTES) -> Any:
    """Parse a UTF-8 file.

    Raises:
        UsageError: one line: it cannot be read, is larger than `cap_bytes`, or fails in `parse_yaml`.
    """
    try:
        with path.open("rb") as file:
            data = file.read(cap_bytes + 1)
    except OSError as error:
        raise UsageError(f"{path}: cannot be read: {error}") from error
    if len(data) > cap_bytes:
        raise UsageError(f"{path}: is larger than {cap_bytes >> 10} KiB")
    return parse_yaml(data, where=str(path))


def parse_yaml(data: bytes, *, where: str) -> Any:
    """Parse UTF-8 text into mappings, lists, text, numbers, dates, booleans and None.

    Args:
        data: the whole text.
        where: names the source in errors.

    Raises:
        UsageError: one line: not YAML, a Python object, an alias, a duplicate key or too deep nesting.
    """
    try:
        text = data.decode("utf-8")
        _check(text)
        return yaml.load(text, Loader=_StrictLoader)
    except (yaml.YAMLError, ValueError) as error:  # ValueError: no date, or a number of thousands of digits
        raise UsageError(f"{where}: not valid YAML: {line_of(error)}") from error


def _check(text: str) -> None:
    """Refuse aliases and deep nesting before anything is built.

    Raises:
        YAMLError: found one, or the text is not YAML.
    """
    depth = 0
    for event in yaml.parse(text, Loader=_Loader):
        if isinstance(event, yaml.AliasEvent):
            raise _refusal(f"an alias (*{event.anchor}) is not read; write it out", event.start_mark)
        if isinstance(event, yaml.CollectionStartEvent):
            depth += 1
        elif isinstance(event, yaml.CollectionEndEvent):
            depth -= 1
        if depth > DEEPEST:
            raise _refusal(f"nested deeper than {DEEPEST} levels", event.start_mark)


def _refusal(why: str, mark: Any) -> yaml.YAMLError:
    return yaml.YAMLError(f"line {mark.line + 1}: {why}")
