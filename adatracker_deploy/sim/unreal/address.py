"""Names of scenes that an UnrealCV server draws: ``unrealcv/HOST:PORT/LEVEL``. Pure."""

from __future__ import annotations

from dataclasses import dataclass
from urllib.parse import parse_qs, urlsplit

from adatracker_deploy.core.errors import UsageError

FORM = "unrealcv/HOST:PORT/LEVEL[?settings=FILE][&camera=ID]"
LOOPBACK = ("127.0.0.1", "::1", "localhost")


@dataclass(frozen=True, slots=True)
class Address:
    """A level behind a server."""

    host: str
    port: int
    level: str
    """As `vget /level/name` says it."""
    settings: str = ""
    """Path of UnrealZoo's setting file of the level; empty for none."""
    camera: int | None = None
    """Id of the camera to use; by default one is spawned."""


def parse_address(scene: str) -> Address:
    """Read a scene's name.

    Raises:
        UsageError: it is not of the form `FORM`.
    """
    try:
        url = urlsplit(scene.replace("/", "://", 1))
        query = parse_qs(url.query, strict_parsing=True) if url.query else {}
        level, port, camera = url.path.removeprefix("/"), url.port, query.get("camera", [""])[-1]
    except ValueError as error:
        raise UsageError(f"scene {scene!r}: {error}; expected {FORM}") from error
    known = query.keys() <= {"settings", "camera"} and (not camera or camera.isdecimal())
    if not (url.hostname and port and level and level.isprintable() and known) or " " in level:
        raise UsageError(f"scene {scene!r}: expected {FORM}")
    settings = query.get("settings", [""])[-1]
    return Address(url.hostname, port, level, settings, int(camera) if camera else None)
