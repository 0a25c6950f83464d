"""A robot's YAML profile as typed, range-checked settings.

The policy never sees a profile: it infers camera height and dynamics. What a profile says of the camera's
place or of the body's dynamics is in ``sitl:`` alone and describes the simulated far end.
"""

from __future__ import annotations

import contextlib
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from adatracker_deploy.errors import UsageError
from adatracker_deploy.platform import Limits, Platform, load_platform, platform_names
from adatracker_deploy.schema import Range, parse
from adatracker_deploy.yaml_text import read_yaml

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraSettings:
    """Where frames come from, and how often."""

    uri: str
    """``world://SCENE`` renders a virtual world from the pose that the robot itself reports."""
    rate_hz: Annotated[float, Range(1, 240)] = 30.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Profile:
    """One robot: how to reach it, what it may do and, for rehearsals, what it is like."""

    name: str
    platform: str
    description: str
    limits: Limits
    camera: CameraSettings
    connection: Any
    """An instance of the platform's `Connection`."""
    sitl: Any
    """An instance of the platform's `SitlSettings`."""


@dataclass(frozen=True, slots=True, kw_only=True)
class _Document:
    platform: str
    description: str
    limits: Limits
    camera: CameraSettings
    connection: dict[str, Any]
    sitl: dict[str, Any]


def profile_dir() -> Path:
    """Return the folder of the shipped profiles: inside the installed package, or beside it in a checkout."""
    package = Path(__file__).parent
    inside = package / "calib-free-profiles"
    return inside if inside.is_dir() else package.parent / "calib-free-profiles"


def profile_names() -> list[str]:
    """Return the names of the shipped profiles and of those that installed robots bring along, sorted."""
    return sorted(_profiles(_usable_platforms()))


def load_profile(name_or_path: str, platform: type[Platform] | None = None) -> Profile:
    """Read a profile by name, or any profile by path (anything with a slash or a .yaml ending).

    Named can be what is shipped and what is in the `profile_dir` of `platform`, or else of every installed
    robot; a robot's own come first.

    Args:
        name_or_path: which profile.
        platform: the platform it must be for; by default the one it names.

    Raises:
        UsageError: no such profile, not YAML, a wrong key, type or range, or another platform's profile.
    """
    path = _find(name_or_path, platform)
    document = parse(_Document, read_yaml(path), where=str(path))
    if platform is None:
        platform = load_platform(document.platform)
    elif platform.name != document.platform:
        raise UsageError(f"{path}: is a profile for platform {document.platform!r}, not {platform.name!r}")
    return Profile(
        name=path.stem,
        platform=document.platform,
        description=document.description,
        limits=document.limits,
        camera=document.camera,
        connection=parse(platform.Connection, document.connection, where=f"{path}: connection"),
        sitl=parse(platform.SitlSettings, document.sitl, where=f"{path}: sitl"),
    )


def load_limits(name_or_path: str) -> Limits:
    """Read a profile's limits alone, without its robot's library.

    Raises:
        UsageError: as `load_profile`, but for what is in the robot's own sections.
    """
    path = _find(name_or_path, None)
    return parse(_Document, read_yaml(path), where=str(path)).limits


def _find(name_or_path: str, platform: type[Platform] | None) -> Path:
    if "/" in name_or_path or name_or_path.endswith((".yaml", ".yml")):
        path = Path(name_or_path)
        if not path.is_file():
            raise UsageError(f"profile {name_or_path}: no such file")
        return path
    known = _profiles([platform] if platform else _usable_platforms())
    if name_or_path not in known:
        names = ", ".join(sorted(known)) or "none"
        raise UsageError(
            f"unknown profile {name_or_path!r}: known are {names}; or give a path to a YAML file"
        )
    return known[name_or_path]


def _profiles(platforms: Iterable[type[Platform]]) -> dict[str, Path]:
    """Return the file of every profile that can be named; a robot's own stands before a shipped one."""
    brought = (platform.profile_dir for platform in platforms)
    folders = [profile_dir(), *(folder for folder in brought if folder is not None)]
    return {path.stem: path for folder in folders for path in folder.glob("*.yaml")}


def _usable_platforms() -> Iterator[type[Platform]]:
    for name in platform_names():
        with contextlib.suppress(UsageError):  # what it lacks is told by ``platforms``
            yield load_platform(name)
