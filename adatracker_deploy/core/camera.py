"""The camera interface and camera URIs.

``world://SCENE`` is rendered from the robot's reported pose, by this package or, where the scene is
``unrealcv/HOST:PORT/LEVEL``, by Unreal's engine; ``robot://TOPIC`` arrives over the robot's own connection;
`perception.sources` lists the rest.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Protocol

from adatracker_deploy.core.errors import PlatformError

if TYPE_CHECKING:
    from adatracker_deploy.core.messages import Frame

WORLD = "world://"
UNREAL = "unrealcv/"
"""Begins the scenes of UnrealCV servers."""
ROBOT = "robot://"
ON_A_WIRE = (ROBOT, "http://", "https://")
"""Camera schemes that carry ground truth with each frame in a rehearsal."""
OPEN_TIMEOUT_S = 5.0
"""Machine time, s, within which an opened camera must deliver its first frame."""
LARGEST_SIDE = 8192
"""Largest width or height of an image, px; larger ones are refused before they are decoded."""


class FilmOverError(PlatformError):
    """A recorded video has ended."""


class Camera(Protocol):
    """A source of frames; gives the newest one."""

    def open(self) -> None:
        """Open the camera; return once frames arrive.

        Raises:
            UsageError: there is no such device, file or address.
            PlatformError: no frame came within `OPEN_TIMEOUT_S`.
        """

    def read(self, now_ns: int) -> Frame | None:
        """Return the newest frame, captured at `now_ns` or before; None while there is none yet.

        The same frame may be returned again; compare sequence numbers.

        Raises:
            PlatformError: the camera is lost; no more frames will come.
        """

    def go(self) -> None:
        """Signal that the robot is about to follow; in a rehearsal the people start walking."""

    def close(self) -> None:
        """Release the device; may be called twice, and before `open`."""


def scene_of(uri: str) -> str | None:
    """Return the scene's name in ``world://SCENE``, or None for any other URI."""
    return uri.removeprefix(WORLD) if uri.startswith(WORLD) else None


def is_unreal(scene: str) -> bool:
    """Return whether a scene is an UnrealCV server's."""
    return scene.startswith(UNREAL)


def without_password(uri: str) -> str:
    """Return a camera's address without any user name and password, safe to display."""
    return re.sub(r"://[^/?#]*@", "://", uri)


def check_size(width: int, height: int) -> None:
    """Check that an image of this size, px, may be decoded.

    Raises:
        ValueError: a side is 0 or longer than `LARGEST_SIDE`.
    """
    if not (0 < width <= LARGEST_SIDE and 0 < height <= LARGEST_SIDE):
        raise ValueError(f"pictures of {width}x{height} px: expected sides of 1 to {LARGEST_SIDE}")
