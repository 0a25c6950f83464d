"""The virtual camera shows the world from where the robot says it is."""

from __future__ import annotations

import math

import pytest

from adatracker_deploy.core.camera import scene_of
from adatracker_deploy.core.clock import FakeClock, MonotonicClock
from adatracker_deploy.core.errors import PlatformError
from adatracker_deploy.core.geometry import Pose
from adatracker_deploy.perception.pipeline import Perception
from adatracker_deploy.perception.segmenter import TruthSegmenter
from adatracker_deploy.perception.world_camera import WorldCamera
from adatracker_deploy.platform import CameraMount, Scenario
from tests.trial.test_log import eventually

HOVERING = Pose(100.0, -40.0, 2.0, yaw=2.0)
WIDTH_PX = 96


class Robot:
    """Reports a pose in a frame of its own, far from the world's."""

    def __init__(self, pose=None):
        self.pose = pose
        self.clock = MonotonicClock()

    def camera(self, **scenario):
        mount = CameraMount(pitch_deg=20.0)
        return WorldCamera(
            Scenario(seed=1, width_px=WIDTH_PX, **scenario), mount, lambda: self.pose, self.clock, 20.0
        )

    def newest(self, camera, after=0):
        """The first picture behind the one of this number."""
        found = []

        def came():
            frame = camera.read(self.clock.now_ns())
            found[:] = [frame] if frame is not None and frame.seq > after else []
            return bool(found)

        eventually(came)
        return found[0]


def test_it_waits_for_a_pose_and_shows_the_target_ahead_and_people_walk_once_they_may():
    robot = Robot()
    camera = robot.camera()
    camera.open()
    try:
        assert camera.read(robot.clock.now_ns()) is None
        robot.pose = HOVERING
        first = robot.newest(camera)
        assert first.rgb.shape == (72, 96, 3)
        assert first.truth.distance_m == pytest.approx(2.5, abs=0.05)
        assert first.truth.bearing_rad == pytest.approx(0.0, abs=0.02)
        later = robot.newest(camera, first.seq + 2)
        assert later.truth.target_xy == first.truth.target_xy
        assert later.t_ns > first.t_ns
        camera.go()
        eventually(lambda: math.dist(robot.newest(camera).truth.target_xy, first.truth.target_xy) > 0.2)
    finally:
        camera.close()
        camera.close()


def test_a_world_that_cannot_be_drawn_is_told_by_the_next_read():
    robot = Robot(HOVERING)
    camera = robot.camera(scene="nowhere")
    camera.open()
    with pytest.raises(PlatformError, match="unknown scene 'nowhere'"):
        eventually(lambda: camera.read(robot.clock.now_ns()) is not None)
    camera.close()


def test_a_camera_that_was_never_opened_can_be_closed():
    Robot().camera().close()


@pytest.mark.parametrize(
    ("uri", "scene"),
    [("world://urban_city", "urban_city"), ("world://", ""), ("0", None), ("rtsp://10.0.0.1/", None)],
)
def test_only_a_world_names_a_scene(uri, scene):
    assert scene_of(uri) == scene


def test_what_ends_the_camera_reaches_whoever_asks_for_the_newest():
    class Broken:
        def read(self, now_ns):
            raise RuntimeError("lens cap")

    perception = Perception(Broken(), TruthSegmenter(), FakeClock(), rate_hz=20.0)
    perception.close()
    with pytest.raises(PlatformError, match="RuntimeError: lens cap"):
        perception.newest()
