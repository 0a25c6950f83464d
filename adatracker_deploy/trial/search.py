"""Finds files in and below folders: each once, and unreadable folders are reported, not taken as empty."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from adatracker_deploy.trial.folder import FILE_NAME, PART_NAME

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable


class Found(NamedTuple):
    """Result of a search, both lists sorted."""

    files: list[Path]
    refused: list[Path]
    """Folders that may not be read."""


def search(folder: Path, wanted: Callable[[str], bool]) -> Found:
    """Return the files whose name is wanted in and below a folder."""
    refused: list[Path] = []

    def note(error: OSError) -> None:
        refused.append(Path(error.filename))

    files = [
        Path(place) / name
        for place, _, names in os.walk(folder, onerror=note)
        for name in names
        if wanted(name)
    ]
    return Found(sorted(files), sorted(refused))


def each_once(paths: Iterable[Path], seen: set[Path]) -> list[Path]:
    """Return the paths that name no trial or file in `seen`, and add what they name to it.

    A trial may be named by its folder, its file, or both: ``score trials trials/THE_LAST_ONE``.
    """
    fresh = []
    for path in paths:
        named = (path.parent if path.name in (FILE_NAME, PART_NAME) else path).resolve()
        if named not in seen:
            seen.add(named)
            fresh.append(path)
    return fresh
