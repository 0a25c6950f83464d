"""Which camera a URI means."""

from __future__ import annotations

from typing import TYPE_CHECKING

from adatracker_deploy.errors import UsageError
from adatracker_deploy.perception.camera import ROBOT, WORLD

if TYPE_CHECKING:
    from adatracker_deploy.perception.camera import Camera
    from adatracker_deploy.runtime.clock import Clock


def check_uri(uri: str) -> None:
    """Tell now, before anything starts, whether a camera URI can mean anything.

    Raises:
        UsageError: it cannot.
    """
    if not uri.startswith((ROBOT, WORLD)) or uri in (ROBOT, WORLD):
        raise UsageError(f"camera {uri!r}: expected {WORLD}SCENE or {ROBOT}TOPIC")


def open_source(uri: str, clock: Clock) -> Camera:
    """Return the camera that `uri` means, not open yet.

    Raises:
        UsageError: no camera is reached that way.
    """
    raise UsageError(f"camera {uri!r}: cannot be opened on {clock}")
