"""The topic of a robot's own camera comes from its URI, or else from its connection."""

from __future__ import annotations

from dataclasses import replace

import pytest

from adatracker_deploy.config.camera_topic import with_camera, with_robots_camera
from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.registry import load_profile


def profile(uri, topic):
    shipped = load_profile("go2")
    connection = replace(shipped.connection, camera_topic=topic)
    return replace(shipped, connection=connection, camera=replace(shipped.camera, uri=uri))


@pytest.mark.parametrize(
    ("uri", "topic", "named"),
    [
        ("robot://front/image", "rear/image", "front/image"),
        ("robot://", "rear/image", "rear/image"),
        ("0", "rear/image", "rear/image"),
    ],
)
def test_the_uri_goes_before_the_connection(uri, topic, named):
    there = profile(uri, topic)
    assert with_camera(there) == replace(there.connection, camera_topic=named)


@pytest.mark.parametrize("uri", ["robot://", "world://simple_room"])
def test_a_camera_without_a_topic_is_refused(uri):
    with pytest.raises(UsageError, match=f"camera {uri}: name the topic"):
        with_camera(profile(uri, ""))


@pytest.mark.parametrize(
    ("uri", "topic", "reached"),
    [
        ("robot://front/image", "rear/image", "robot://front/image"),
        ("0", "rear/image", "robot://rear/image"),
        ("0", "", "robot://camera/image_raw/compressed"),
    ],
)
def test_a_rehearsal_looks_through_the_robots_own_camera(uri, topic, reached):
    assert with_robots_camera(profile(uri, topic)).camera.uri == reached
