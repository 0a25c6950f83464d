"""The virtual camera shows the world from where the robot says it is."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from adatracker_deploy.core.camera import scene_of
from adatracker_deploy.core.clock import FakeClock
from adatracker_deploy.core.errors import PlatformError
from adatracker_deploy.core.geometry import Pose
from adatracker_deploy.core.messages import MaskClass
from adatracker_deploy.perception.pipeline import Perception
from adatracker_deploy.perception.segmenter import TruthSegmenter
from adatracker_deploy.perception.world_camera import WorldCamera
from adatracker_deploy.platform import CameraMount
from adatracker_deploy.sim import World

MOUNT = CameraMount(pitch_deg=20.0)
STEP_NS = 50_000_000


class Robot:
    """Reports a pose in a frame of its own, far from the world's."""

    def __init__(self, pose: Pose | None) -> None:
        self.pose = pose

    def camera(self, scene: str = "simple_room") -> WorldCamera:
        return WorldCamera(World(scene, seed=1, obstacles=False), MOUNT, lambda: self.pose, (96, 96))


HOVERING = Pose(100.0, -40.0, 2.0, yaw=2.0)


def test_there_is_no_frame_before_the_robot_has_said_where_it_is():
    assert Robot(None).camera().read(0) is None


@pytest.mark.parametrize("scene", ["simple_room", "snow_village"])
def test_wherever_the_robot_starts_it_faces_the_target_2_5_m_ahead(scene):
    frame = Robot(HOVERING).camera(scene).read(STEP_NS)
    assert frame.truth.distance_m == pytest.approx(2.5, abs=0.05)
    assert frame.truth.bearing_rad == pytest.approx(0.0, abs=0.02)
    box = TruthSegmenter()(frame).box
    assert box.cx == pytest.approx(0.5, abs=0.06)
    assert frame.rgb.shape == (96, 96, 3)


def test_turning_left_moves_the_target_to_the_right():
    robot = Robot(HOVERING)
    camera = robot.camera()
    straight = TruthSegmenter()(camera.read(0)).box
    robot.pose = replace(HOVERING, yaw=HOVERING.yaw + 0.3)
    turned = camera.read(STEP_NS)
    assert TruthSegmenter()(turned).box.cx > straight.cx + 0.1
    assert turned.truth.bearing_rad == pytest.approx(-0.3, abs=0.02)


def test_people_stand_still_until_they_may_go_and_then_walk_in_the_runs_time():
    camera = Robot(HOVERING).camera()
    first, second = camera.read(0), camera.read(10 * STEP_NS)
    assert first.truth.target_xy == second.truth.target_xy
    camera.go()
    camera.read(11 * STEP_NS)
    walked = camera.read(31 * STEP_NS)
    assert math.dist(walked.truth.target_xy, first.truth.target_xy) == pytest.approx(1.0, abs=0.1)
    assert walked.seq == 4


def test_flying_into_the_person_is_a_collision():
    robot = Robot(HOVERING)
    camera = robot.camera()
    assert not camera.read(0).truth.collided
    robot.pose = HOVERING @ Pose(x=2.5, z=-1.0)
    assert camera.read(STEP_NS).truth.collided


def test_the_mask_shows_the_target_where_its_box_is():
    observation = TruthSegmenter()(Robot(HOVERING).camera().read(0))
    row, column = int(observation.box.cy * 96), int(observation.box.cx * 96)
    assert MaskClass.TARGET in observation.mask[row - 3 : row + 3, column - 3 : column + 3]


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
