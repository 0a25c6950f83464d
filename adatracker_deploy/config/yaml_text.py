"""YAML as settings need it: plain values, each written out once. `schema` then says what they may be.

Three things that YAML allows are refused. An alias can make a small file stand for more values than fit in
memory; nesting without end overflows the stack; of a key that is given twice, a reader sees one and the
program takes the other.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import yaml

from adatracker_deploy.core.errors import UsageError

if TYPE_CHECKING:
    from collections.abc import Hashable
    from pathlib import Path

CAP_BYTES = 1 << 20
DEEPEST = 32

_Loader: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
"""The same rules in C, where PyYAML was built with them."""


class _StrictLoader(_Loader):  # type: ignore[misc]
    """A safe loader that refuses a key that is given twice."""

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
    """Return what a file of UTF-8 says.

    Raises:
        UsageError: one line: it cannot be read, is larger than `cap_bytes`, or as `parse_yaml`.
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
    """Return what UTF-8 text says: mappings, lists, text, numbers, dates, true, false and nothing.

    Args:
        data: all of it.
        where: how errors name the place.

    Raises:
        UsageError: one line: it is no YAML, asks for objects, has an alias, a key twice or too much depth.
    """
    try:
        text = data.decode("utf-8")
        _check(text)
        return yaml.load(text, Loader=_StrictLoader)
    except (yaml.YAMLError, ValueError) as error:  # ValueError: no date, or a number of thousands of digits
        raise UsageError(f"{where}: not valid YAML: {' '.join(str(error).split())}") from error


def _check(text: str) -> None:
    """Refuse aliases and depth before anything is built.

    Raises:
        YAMLError: there is one, or the text is no YAML.
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
