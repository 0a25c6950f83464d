"""Which camera a URI means."""

from __future__ import annotations

from typing import TYPE_CHECKING

from adatracker_deploy.errors import UsageError
from adatracker_deploy.perception.camera import ROBOT, WORLD
from adatracker_deploy.perception.mjpeg import MjpegCamera

if TYPE_CHECKING:
    from adatracker_deploy.perception.camera import Camera
    from adatracker_deploy.runtime.clock import Clock


_HTTP = ("http://", "https://")


def check_uri(uri: str) -> None:
    """Tell now, before anything starts, whether a camera URI can mean anything.

    Raises:
        UsageError: it cannot.
    """
    if not uri.startswith((ROBOT, WORLD, *_HTTP)) or uri in (ROBOT, WORLD, *_HTTP):
        raise UsageError(f"camera {uri!r}: expected {WORLD}SCENE, {ROBOT}TOPIC or http://HOST:PORT/PATH")


def open_source(uri: str, clock: Clock) -> Camera:
    """Return the camera that `uri` means, not open yet.

    Raises:
        UsageError: no camera is reached that way.
    """
    check_uri(uri)
    if uri.startswith(_HTTP):
        return MjpegCamera(uri, clock)
    raise UsageError(f"camera {uri!r}: cannot be opened here")
