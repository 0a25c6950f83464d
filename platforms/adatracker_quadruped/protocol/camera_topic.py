"""Determines the robot's image topic: the one after ``robot://``, or the connection's."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from adatracker_deploy.core.camera import ROBOT
from adatracker_deploy.core.errors import UsageError

if TYPE_CHECKING:
    from adatracker_deploy.config.profile import Profile
    from adatracker_quadruped.protocol.connection import Connection


def with_camera(profile: Profile) -> Connection:
    """Return the profile's connection with the topic that its camera's URI names.

    Raises:
        UsageError: neither names a topic.
    """
    connection: Connection = profile.connection
    uri = profile.camera.uri
    topic = uri.removeprefix(ROBOT) if uri.startswith(ROBOT) else ""
    connection = replace(connection, camera_topic=topic or connection.camera_topic)
    if not connection.camera_topic:
        raise UsageError(
            f"camera {uri}: name the topic of the robot's images, such as {ROBOT}camera/image_raw/compressed"
        )
    return connection
