"""Camera sources: what a camera is, and what its URI says.

``world://SCENE`` is drawn in this process from the pose that the robot reports, ``robot://TOPIC`` arrives on
the robot's own wire; what else there is stands in `sources`.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Protocol

from adatracker_deploy.core.errors import PlatformError

if TYPE_CHECKING:
    from adatracker_deploy.core.messages import Frame

WORLD = "world://"
ROBOT = "robot://"
ON_A_WIRE = (ROBOT, "http://", "https://")
"""Cameras that in a rehearsal carry the truth beside the picture."""
OPEN_TIMEOUT_S = 5.0
"""Machine time within which an opened camera must have given its first frame."""
LARGEST_SIDE = 8192
"""Of any picture, px; larger ones are refused before they are decoded."""


class FilmOverError(PlatformError):
    """A recorded video has been shown to its end."""


class Camera(Protocol):
    """Something that gives the newest frame."""

    def open(self) -> None:
        """Begin; return once frames come.

        Raises:
            UsageError: there is no such device, file or address.
            PlatformError: no frame came within `OPEN_TIMEOUT_S`.
        """

    def read(self, now_ns: int) -> Frame | None:
        """Return the newest frame, captured at `now_ns` or before; None while there is none yet.

        The same frame may come again: its sequence number tells.

        Raises:
            PlatformError: the camera is gone, and no frame will follow.
        """

    def go(self) -> None:
        """The robot is about to follow: in a rehearsal the people walk from now on."""

    def close(self) -> None:
        """Let go of the device; may be called twice, and before `open`."""


def scene_of(uri: str) -> str | None:
    """Return the scene's name in ``world://SCENE``, or None for any other URI."""
    return uri.removeprefix(WORLD) if uri.startswith(WORLD) else None


def without_password(uri: str) -> str:
    """Return a camera's address as it may be shown: without the user and the password that it may hold."""
    return re.sub(r"://[^/?#]*@", "://", uri)


def check_size(width: int, height: int) -> None:
    """See that a picture of this size, px, may be decoded.

    Raises:
        ValueError: a side is 0 or longer than `LARGEST_SIDE`.
    """
    if not (0 < width <= LARGEST_SIDE and 0 < height <= LARGEST_SIDE):
        raise ValueError(f"pictures of {width}x{height} px: expected sides of 1 to {LARGEST_SIDE}")
