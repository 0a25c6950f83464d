"""Finds files in and below a folder; unreadable folders are reported, not taken as empty."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from collections.abc import Callable


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
