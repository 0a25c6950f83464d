"""UnrealZoo's own setting file of a map: who walks in it, and from where."""

from __future__ import annotations

import json
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from adatracker_deploy.core.errors import UsageError

BACKGROUND = (
    r"floor|ground|landscape|terrain|road|street|pavement|wall|ceiling|sky|water|ocean|grass|cloud|fog|light"
)
"""Names of objects, in whole or in part and in any case, that are no obstacles; ours, and the map's file may
give another."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Settings:
    """Values taken from the file; the defaults are what all of UnrealZoo's files of 2025 say."""

    player: str = "BP_Character_2"
    """The object that is the target."""
    class_name: str = "bp_character_C"
    """The class of which other people, and the robot's body, are spawned."""
    starts: tuple[tuple[float, float, float], ...] = ()
    """Free places in the engine's frame, cm; where people begin. Without any they begin where they stand."""
    background: str = BACKGROUND
    """A regular expression, see `BACKGROUND`; the key is this toolkit's own."""


def read_settings(path: str) -> Settings:
    """Read a map's file, such as `gym_unrealcv/envs/setting/Track/Greek_Island.json`; no path: the defaults.

    Raises:
        UsageError: there is no such file, or it is none of UnrealZoo's.
    """
    if not path:
        return Settings()
    try:
        return _settings(json.loads(Path(path).read_text(encoding="utf-8")))
    except OSError as error:
        raise UsageError(f"{path}: cannot be read ({error.strerror})") from error
    except (ValueError, KeyError, IndexError, TypeError, re.error) as error:
        raise UsageError(f"{path}: not UnrealZoo's setting file of a map ({error!r})") from error


def _settings(given: Any) -> Settings:
    player = given["agents"]["player"]
    starts = tuple((float(x), float(y), float(z)) for x, y, z in given["safe_start"])
    return Settings(
        player=str(player["name"][0]),
        class_name=str(player["class_name"][0]),
        starts=starts,
        background=re.compile(given.get("background", BACKGROUND)).pattern,
    )
