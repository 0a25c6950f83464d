"""The simulated robot's images, compressed and raw, with the truth of each, by the robot's own camera."""

import dataclasses

import pytest

pytest.importorskip("rclpy", reason="ROS 2 is not installed: pip install 'adatracker-deploy[ros2]'")

from adatracker_deploy.core.clock import MonotonicClock
from adatracker_ros2.platform import Ros2Platform
from tests.ros2.rehearsal import rehearsed, simulator, until


@pytest.mark.parametrize("images", ["compressed", "raw"])
def test_images_of_both_types_come_with_their_truth_and_the_people_walk_when_told(images):
    profile = rehearsed()
    profile = dataclasses.replace(
        profile,
        sitl=dataclasses.replace(profile.sitl, images=images),
        camera=dataclasses.replace(profile.camera, rate_hz=5.0),
    )
    with simulator(profile) as (_, robot):
        camera = Ros2Platform.camera(robot, MonotonicClock())
        camera.open()
        try:
            first = newest(camera)
            assert first.rgb.shape == (120, 160, 3)
            assert first.rgb.std() > 10
            assert (first.jpeg is not None) == (images == "compressed")
            assert first.truth.mask.any()
            camera.go()
            until(lambda: newest(camera).truth.target_xy != first.truth.target_xy, "nobody walked")
        finally:
            camera.close()


def newest(camera):
    frames = []
    until(lambda: frames.append(camera.read(camera.clock.now_ns())) or frames[-1] is not None)
    return frames[-1]
