"""Foxglove's layout for trials, which is `live_layout.json` beside this file."""

from __future__ import annotations

from pathlib import Path


def live_layout() -> str:
    """Return the layout, JSON as Foxglove imports it."""
    return Path(__file__).with_suffix(".json").read_text(encoding="utf-8")
