"""Finds missing optional extras of this package, by its own metadata."""

from __future__ import annotations

import re
from importlib import metadata
from typing import TYPE_CHECKING

from adatracker_deploy.core.errors import UsageError

if TYPE_CHECKING:
    from collections.abc import Iterable

DISTRIBUTION = "adatracker-deploy"


def need(extras: Iterable[str], what: str) -> None:
    """Check that extras are installed; those that this package does not have are somebody else's.

    Args:
        extras: by name.
        what: needs them, for the message.

    Raises:
        UsageError: some are not; the one command that installs them all is named.
    """
    needed = requirements(metadata.requires(DISTRIBUTION) or (), extras)
    missing = {extra: [name for name in names if not installed(name)] for extra, names in needed.items()}
    missing = {extra: names for extra, names in missing.items() if names}
    if missing:
        names = ", ".join(sorted({name for found in missing.values() for name in found}))
        asked = ",".join(sorted(missing))
        raise UsageError(f"{what} needs {names}: pip install '{DISTRIBUTION}[{asked}]'")


def requirements(lines: Iterable[str], extras: Iterable[str]) -> dict[str, list[str]]:
    """Return the distributions that each extra needs, by metadata's ``Requires-Dist`` lines (PEP 508)."""
    found: dict[str, list[str]] = {}
    nested: dict[str, list[str]] = {}
    for line in lines:
        extra = re.search(r"extra\s*==\s*['\"]([^'\"]+)['\"]", line)
        name = re.match(r"[A-Za-z0-9._-]+", line)
        if extra is None or name is None:
            continue
        if name[0] == DISTRIBUTION:
            inner = re.search(r"\[([^\]]*)\]", line)
            nested.setdefault(extra[1], []).extend(inner[1].replace(" ", "").split(",") if inner else ())
        else:
            found.setdefault(extra[1], []).append(name[0])

    def whole(extra: str) -> list[str]:
        return [*found.get(extra, ()), *(name for inner in nested.get(extra, ()) for name in whole(inner))]

    return {extra: whole(extra) for extra in extras}


def installed(distribution: str) -> bool:
    """Return whether a distribution is installed."""
    try:
        metadata.distribution(distribution)
    except metadata.PackageNotFoundError:
        return False
    return True
