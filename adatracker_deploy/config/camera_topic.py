"""The topic of a robot's own camera: the one after ``robot://``, or the connection's `camera_topic`."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

from adatracker_deploy.core.camera import ROBOT
from adatracker_deploy.core.errors import UsageError

if TYPE_CHECKING:
    from adatracker_deploy.config.profile import Profile

_USUAL = "camera/image_raw/compressed"


def with_camera(profile: Profile) -> Any:
    """Return the profile's connection with the topic that its camera's URI names.

    Raises:
        UsageError: neither names a topic.
    """
    uri = profile.camera.uri
    topic = uri.removeprefix(ROBOT) if uri.startswith(ROBOT) else ""
    topic = topic or profile.connection.camera_topic
    if not topic:
        raise UsageError(f"camera {uri}: name the topic of the robot's images, such as {ROBOT}{_USUAL}")
    return replace(profile.connection, camera_topic=topic)


def with_robots_camera(profile: Profile) -> Profile:
    """Return the profile with the camera on the robot's own wire, whichever the profile names."""
    if profile.camera.uri.startswith(ROBOT):
        return profile
    topic = profile.connection.camera_topic or _USUAL
    return replace(profile, camera=replace(profile.camera, uri=f"{ROBOT}{topic}"))
