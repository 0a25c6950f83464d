"""A fleet's file: its robots by name, the command's options of each, and what the failure of one means.

::

    on_failure: stop-all          # or go-on
    common: {steps: 600}          # options of the command, without their dashes, for every robot
    robots:
      left: {platform: wheeled, profile: left.yaml}
      hawk: {platform: drone, steps: 900}
"""

from __future__ import annotations

import dataclasses
import difflib
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

from adatracker_deploy.config.schema import parse
from adatracker_deploy.core.errors import UsageError

OnFailure = Literal["stop-all", "go-on"]
"""Reaction of the others when a robot fails: all stop, or the rest goes on."""
Kind = Literal["flag", "value", "either", "list"]
"""Values of an option: none, one, one or none, or several."""
_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_-]{0,31}")
OF_THE_COMMAND = frozenset({"sitl", "dry-run", "log-dir", "stop-fd", "on-hangup", "json"})
"""Options that hold for all robots: whether they move, where they log, and what stops them."""


@dataclass(frozen=True, slots=True)
class FleetRobot:
    """One robot of a fleet."""

    name: str
    arguments: tuple[str, ...]
    """Its own command line: the common options, replaced by its own where it has them."""


@dataclass(frozen=True, slots=True)
class Fleet:
    """A set of robots that one command runs."""

    robots: tuple[FleetRobot, ...]
    on_failure: OnFailure


@dataclass(frozen=True, slots=True, kw_only=True)
class _Document:
    robots: dict[str, dict[str, Any]]
    common: dict[str, Any] = dataclasses.field(default_factory=dict)
    on_failure: OnFailure = "stop-all"


def parse_fleet(document: Any, known: Mapping[str, Kind], *, where: str) -> Fleet:
    """Read a fleet from a file's contents.

    Args:
        document: as `read_yaml` gives it.
        known: the options that a robot may have, and what each takes.
        where: names the file in errors.

    Raises:
        UsageError: one line: no robot, a bad name, an unknown option, or a value that it cannot take.
    """
    read = parse(_Document, document, where=where)
    common = _arguments(read.common, known, where=f"{where}: common")
    robots = []
    for name, options in read.robots.items():
        place = f"{where}: robots: {name}"
        if not _NAME.fullmatch(name):
            raise UsageError(f"{place}: a name is a letter, then up to 31 letters, digits, '-' and '_'")
        merged = common | _arguments(options, known, where=place)
        if not merged.get("platform"):
            raise UsageError(f"{place}: missing option 'platform'")
        robots.append(FleetRobot(name, tuple(word for words in merged.values() for word in words)))
    if not robots:
        raise UsageError(f"{where}: robots: there is none")
    return Fleet(tuple(robots), read.on_failure)


def first_shared(values: Mapping[str, str | None]) -> tuple[str, str] | None:
    """Return the first two names with the same value, which is neither None nor empty; None without any."""
    first: dict[str, str] = {}
    for name, value in values.items():
        if value and first.setdefault(value, name) != name:
            return first[value], name
    return None


def _arguments(
    options: Mapping[str, Any], known: Mapping[str, Kind], *, where: str
) -> dict[str, tuple[str, ...]]:
    """Return the arguments of each option."""
    for key in options:
        if key in OF_THE_COMMAND:
            raise UsageError(f"{where}: {key!r} is said for all, on the command line: --{key}")
        if key not in known:
            near = difflib.get_close_matches(key, known, n=1)
            hint = f"did you mean {near[0]!r}?" if near else "see adatracker-deploy --help"
            raise UsageError(f"{where}: unknown option {key!r}; {hint}")
    return {key: _words(key, value, known[key], f"{where}: {key}") for key, value in options.items()}


def _words(key: str, value: Any, kind: Kind, where: str) -> tuple[str, ...]:
    if isinstance(value, bool):
        if kind not in ("flag", "either"):
            raise UsageError(f"{where}: expected a value, got {str(value).lower()}")
        return (f"--{key}",) if value else ()
    if kind == "flag":
        raise UsageError(f"{where}: expected true or false, got {value!r}")
    values = value if kind == "list" and isinstance(value, list) else [value]
    for one in values:
        if isinstance(one, bool) or not isinstance(one, str | int | float):
            raise UsageError(f"{where}: expected text or a number, got {one!r}")
    return tuple(f"--{key}={one}" for one in values)
