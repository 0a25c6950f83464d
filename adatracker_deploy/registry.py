"""Finds robots by entry point and loads their profiles (YAML) as typed, range-checked settings.

A robot's package is imported only when that robot is loaded.
"""

from __future__ import annotations

import contextlib
from dataclasses import dataclass
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import TYPE_CHECKING, Any

from adatracker_deploy.config.limits import Limits
from adatracker_deploy.config.profile import CameraSettings, Profile
from adatracker_deploy.config.schema import parse
from adatracker_deploy.config.yaml_text import read_yaml
from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.platform import Platform

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

ENTRY_POINT_GROUP = "adatracker_deploy.platforms"
_DISTRIBUTION = "adatracker-deploy"
"""For robots of this distribution, errors name the extra to install; for others, the missing library."""


@dataclass(frozen=True, slots=True, kw_only=True)
class _Document:
    platform: str
    description: str
    limits: Limits
    camera: CameraSettings
    connection: dict[str, Any]
    sitl: dict[str, Any]


def profile_dir() -> Path:
    """Return the folder of the shipped profiles: in the installed package, or beside it in a checkout."""
    package = Path(__file__).parent
    inside = package / "calib-free-profiles"
    return inside if inside.is_dir() else package.parent / "calib-free-profiles"


def profile_names() -> list[str]:
    """Return the sorted names of the shipped profiles and of those in installed robot packages."""
    return sorted(_profiles(_usable_platforms()))


def load_profile(name_or_path: str, platform: type[Platform] | None = None) -> Profile:
    """Read a profile by name, or any profile by path (anything with a slash or a .yaml ending).

    Names are searched in the `profile_dir` of `platform` (or of every installed robot), then among the
    shipped ones.

    Args:
        name_or_path: which profile.
        platform: the platform that the profile must name; by default any.

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
    """Read only a profile's limits; the robot's library is not needed.

    Raises:
        UsageError: as `load_profile`, except for errors in the robot's own sections.
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
    """Return the file of every named profile; a robot's own overrides a shipped one."""
    brought = (platform.profile_dir for platform in platforms)
    folders = [profile_dir(), *(folder for folder in brought if folder is not None)]
    return {path.stem: path for folder in folders for path in folder.glob("*.yaml")}


def _usable_platforms() -> Iterator[type[Platform]]:
    for name in platform_names():
        with contextlib.suppress(UsageError):  # ``platforms`` reports what it lacks
            yield load_platform(name)


def _registered() -> dict[str, EntryPoint]:
    return {point.name: point for point in entry_points(group=ENTRY_POINT_GROUP)}


def platform_names() -> list[str]:
    """Return the names of the installed platforms, sorted; imports none of them."""
    return sorted(_registered())


def load_platform(name: str) -> type[Platform]:
    """Import a robot's package and return its `Platform` class.

    Raises:
        UsageError: no such robot is installed, its library is missing, or its entry point leads nowhere.
    """
    point = _registered().get(name)
    if point is None:
        known = ", ".join(platform_names()) or "none"
        raise UsageError(f"unknown platform {name!r}: installed are {known}")
    try:
        loaded = point.load()
    except ImportError as error:
        ours = point.dist is not None and point.dist.name == _DISTRIBUTION
        missing = f"'{_DISTRIBUTION}[{name}]'" if ours else error.name
        raise UsageError(f"platform {name!r} needs {error.name}: pip install {missing}") from error
    except AttributeError as error:
        raise UsageError(f"platform {name!r}: {point.value} cannot be loaded: {error}") from error
    if not (isinstance(loaded, type) and issubclass(loaded, Platform)):
        raise UsageError(f"platform {name!r}: {point.value} is not a subclass of Platform")
    return loaded
