"""A robot's profile as values: how to reach it, what it may do and, for rehearsals, what it is like.

The policy never sees a profile: it infers camera height and dynamics. What a profile says of the camera's
place or of the body's dynamics is in ``sitl:`` alone and describes the simulator.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any

from adatracker_deploy.config.limits import Limits
from adatracker_deploy.config.schema import Range


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
