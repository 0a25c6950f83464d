"""A robot's profile: connection, camera, limits and, for rehearsals, simulator settings.

The policy never sees a profile: it infers camera height and dynamics. The camera's mount and the body's
dynamics are only in ``sitl:`` and describe the simulator.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any

from adatracker_deploy.config.limits import Limits
from adatracker_deploy.config.schema import Range


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraSettings:
    """The camera's address and frame rate."""

    uri: str
    """``world://SCENE`` renders a virtual world from the robot's reported pose."""
    rate_hz: Annotated[float, Range(1, 240)] = 30.0
    fov_deg: Annotated[float, Range(1, 170)] | None = None
    """Horizontal field of view, where it is known. It is logged for whoever looks at the trial elsewhere."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Profile:
    """One robot's connection, camera, limits and simulator settings."""

    name: str
    platform: str
    description: str
    limits: Limits
    camera: CameraSettings
    connection: Any
    """An instance of the platform's `Connection`."""
    sitl: Any
    """An instance of the platform's `SitlSettings`."""
