"""sensor_msgs/CameraInfo: read from ROS 2's own messages, and from the simulated robot's own node."""

import dataclasses
import math

import pytest

pytest.importorskip("rclpy", reason="ROS 2 is not installed: pip install 'adatracker-deploy[ros2]'")

import sensor_msgs.msg

from adatracker_deploy.core.camera_info import CameraInfo
from adatracker_deploy.core.clock import MonotonicClock
from adatracker_ros2.platform import Ros2Platform
from adatracker_ros2.protocol.connection import Connection
from adatracker_ros2.protocol.messages import Malformed, read_camera_info, write_camera_info
from adatracker_ros2.protocol.topics import Topics, is_rectified
from tests.ros2.rehearsal import adapter, rehearsed, simulator, until
from tests.ros2.test_ros2_camera import newest

LENS = CameraInfo(
    width_px=640,
    height_px=480,
    fx=462.1,
    fy=461.3,
    cx=321.0,
    cy=239.5,
    coefficients=(0.1, -0.2, 0.0, 0.0, 0.1),
)
STAMP_NS = 1_700_000_000_000_000_000


@pytest.mark.parametrize(
    ("images", "info", "rectified"),
    [
        ("camera/image_raw/compressed", "/camera/camera_info", False),
        ("/camera/color/image_raw", "/camera/color/camera_info", False),
        ("camera/image_rect_color/compressed", "/camera/camera_info", True),
        ("image_rect", "/camera_info", True),
    ],
)
def test_camera_info_is_beside_the_images_as_image_transport_has_it(images, info, rectified):
    assert Topics(Connection(camera_topic=images)).camera_info == info
    assert is_rectified(images) == rectified


def test_a_named_topic_of_camera_info_is_taken_and_without_images_there_is_none():
    assert (
        Topics(Connection(camera_topic="a/b", camera_info_topic="lens", namespace="r")).camera_info
        == "/r/lens"
    )
    assert Topics(Connection()).camera_info == ""


def test_a_lens_survives_the_way_through_the_message():
    assert read_camera_info(write_camera_info(LENS, STAMP_NS), rectified=False) == LENS


def test_rectified_images_have_the_projections_lens_without_distortion():
    message = write_camera_info(LENS, STAMP_NS)
    message.p = [
        400.0,
        0.0,
        310.0,
        -40.0,
        0.0,
        401.0,
        230.0,
        0.0,
        0.0,
        0.0,
        1.0,
        0.0,
    ]  # a right stereo camera's
    lens = read_camera_info(message, rectified=True)
    assert (lens.fx, lens.fy, lens.cx, lens.cy, lens.coefficients) == (400.0, 401.0, 310.0, 230.0, ())
    assert math.degrees(lens.fov_rad) == pytest.approx(77.3, abs=0.05)


def test_a_binned_picture_and_a_part_of_one_have_their_own_matrices():
    binned = write_camera_info(LENS, STAMP_NS)
    binned.binning_x = binned.binning_y = 2
    half = read_camera_info(binned, rectified=False)
    assert (half.width_px, half.height_px, half.fx, half.cx) == (320, 240, 231.05, 160.5)
    assert half.fov_rad == LENS.fov_rad
    cut = write_camera_info(LENS, STAMP_NS)
    cut.roi.x_offset, cut.roi.y_offset, cut.roi.width, cut.roi.height = 160, 0, 320, 480
    part = read_camera_info(cut, rectified=False)
    assert (part.width_px, part.fx, part.cx) == (320, 462.1, 161.0)
    assert part.fov_rad < LENS.fov_rad


def test_a_camera_that_is_not_calibrated_has_no_lens():
    assert read_camera_info(sensor_msgs.msg.CameraInfo(width=640, height=480), rectified=False) is None


@pytest.mark.parametrize(
    "changes",
    [
        {"width": 0},
        {"width": 100_000},
        {"k": [math.nan, 0.0, 1.0, 0.0, 1.0, 1.0, 0.0, 0.0, 1.0]},
        {"k": [-1.0, 0.0, 1.0, 0.0, 1.0, 1.0, 0.0, 0.0, 1.0]},
        {"d": [math.inf]},
        {"d": [0.0] * 15},
    ],
)
def test_what_is_no_lens_is_malformed(changes):
    message = write_camera_info(LENS, STAMP_NS)
    for name, value in changes.items():
        setattr(message, name, value)
    with pytest.raises(Malformed):
        read_camera_info(message, rectified=False)


@pytest.mark.parametrize("topic", ["camera/image_raw/compressed", "camera/image_rect"])
def test_camera_and_preflight_read_the_lens_from_the_robots_node_and_judge_the_profiles(topic):
    """The simulated lens is 90 degrees wide; rectified images are taken to have no distortion."""
    profile = rehearsed()
    camera = dataclasses.replace(profile.camera, uri=f"robot://{topic}", fov_deg=60.0)
    with simulator(dataclasses.replace(profile, camera=camera)) as (_, robot):
        seen = Ros2Platform.camera(robot, MonotonicClock())
        seen.open()
        try:
            until(lambda: seen.lens is not None, "no lens")
            height, width = newest(seen).rgb.shape[:2]
        finally:
            seen.close()
        assert (seen.lens.width_px, seen.lens.height_px) == (width, height)
        assert math.degrees(seen.lens.fov_rad) == pytest.approx(90.0)
        assert bool(seen.lens.coefficients) == ("raw" in topic)
        with adapter(robot) as platform:
            platform.connect()
            (check,) = (check for check in platform.preflight() if check.name == "lens")
        assert (check.ok, check.blocking) == (False, False)
        assert "camera.fov_deg is 60 in the profile, but 90 degrees by /sitl_" in check.message
