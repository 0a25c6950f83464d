"""Camera sources: where frames come from."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

from adatracker_deploy.errors import UsageError

if TYPE_CHECKING:
    from adatracker_deploy.messages import Frame

WORLD = "world://"


class Camera(Protocol):
    """Something that gives the newest frame."""

    def read(self, now_ns: int) -> Frame | None:
        """Return the newest frame, captured at `now_ns` or before; None while there is none yet."""


def scene_of(uri: str) -> str:
    """Return the scene's name in ``world://SCENE``.

    Raises:
        UsageError: it is another kind of URI.
    """
    if not uri.startswith(WORLD) or uri == WORLD:
        raise UsageError(
            f"camera {uri!r}: expected {WORLD}SCENE, a virtual world seen from the robot's own pose"
        )
    return uri.removeprefix(WORLD)
