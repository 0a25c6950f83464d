"""A robot's YAML profile as typed, range-checked settings.

The policy never sees a profile: it infers camera height and dynamics. What a profile says of the camera's
place or of the body's dynamics is in ``sitl:`` alone and describes the simulated far end.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import yaml

from adatracker_deploy.errors import UsageError
from adatracker_deploy.platform import Limits, Platform, load_platform
from adatracker_deploy.schema import Range, parse


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
    """Return the names of the shipped profiles, sorted."""
    return sorted(path.stem for path in profile_dir().glob("*.yaml"))


def load_profile(name_or_path: str, platform: type[Platform] | None = None) -> Profile:
    """Read a shipped profile by name, or any profile by path (anything with a slash or a .yaml ending).

    Args:
        name_or_path: which profile.
        platform: the platform it must be for; by default the one it names.

    Raises:
        UsageError: no such profile, not YAML, a wrong key, type or range, or another platform's profile.
    """
    path = _find(name_or_path)
    document = parse(_Document, _read(path), where=str(path))
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


def _find(name_or_path: str) -> Path:
    if "/" in name_or_path or name_or_path.endswith((".yaml", ".yml")):
        path = Path(name_or_path)
        if not path.is_file():
            raise UsageError(f"profile {name_or_path}: no such file")
        return path
    path = profile_dir() / f"{name_or_path}.yaml"
    if not path.is_file():
        known = ", ".join(profile_names()) or "none"
        raise UsageError(
            f"unknown profile {name_or_path!r}: shipped are {known}; or give a path to a YAML file"
        )
    return path


_SIZE_CAP_BYTES = 1 << 20


def _read(path: Path) -> Any:
    try:
        if path.stat().st_size > _SIZE_CAP_BYTES:
            raise UsageError(f"{path}: larger than 1 MiB; not a profile")
        return yaml.safe_load(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError) as error:
        raise UsageError(f"{path}: cannot be read: {error}") from error
    except yaml.YAMLError as error:
        line = " ".join(str(error).split())
        raise UsageError(f"{path}: not valid YAML: {line}") from error
