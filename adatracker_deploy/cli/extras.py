"""Finds missing optional extras of this package, by its own metadata."""

from __future__ import annotations

from importlib import metadata
from importlib.util import find_spec
from typing import TYPE_CHECKING

from adatracker_deploy.core.errors import UsageError

if TYPE_CHECKING:
    from collections.abc import Iterable

DISTRIBUTION = "adatracker-deploy"
_ROS = "ros-"
"""Begins the names of ROS 2's wheels; the module of ``ros-nav-msgs`` is ``nav_msgs``."""


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
    """Return the distributions that each extra needs on this machine.

    Args:
        lines: metadata's ``Requires-Dist`` (PEP 508).
        extras: by name.
    """
    from packaging.requirements import Requirement  # which not every command needs

    required = [Requirement(line) for line in lines]

    def whole(extra: str) -> list[str]:
        names: list[str] = []
        for one in required:
            if one.marker is None or not one.marker.evaluate({"extra": extra}):
                continue  # the base's, another extra's, or not for this machine
            if one.name == DISTRIBUTION:
                names += [name for inner in sorted(one.extras) for name in whole(inner)]
            else:
                names.append(one.name)
        return names

    return {extra: whole(extra) for extra in extras}


def installed(distribution: str) -> bool:
    """Return whether a distribution is installed; one of ROS 2's may be there without pip, by its module."""
    try:
        metadata.distribution(distribution)
    except metadata.PackageNotFoundError:
        return distribution.startswith(_ROS) and find_spec(_module(distribution)) is not None
    return True


def _module(distribution: str) -> str:
    return distribution.removeprefix(_ROS).replace("-", "_")
