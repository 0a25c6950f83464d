"""Fog: contrast falls with the distance as Koschmieder says, and the distance is the world's."""

from __future__ import annotations

import math

import numpy as np
import pytest

from adatracker_deploy.config.effects import Effects
from adatracker_deploy.core.geometry import Pose
from adatracker_deploy.core.messages import MaskClass
from adatracker_deploy.sim import World
from adatracker_deploy.sim.render.fog import background_m, fogged
from adatracker_deploy.sim.scenes import build_scene

pytest.importorskip("panda3d", reason="needs the extra 'world'")

FOV_RAD = math.radians(90.0)
HEIGHT, WIDTH = 120, 160
AIR = (0.8, 0.8, 0.8)


def seen(world, *, away_m=2.5):
    x, y = world.target_xy
    yaw = world.start.yaw
    camera = Pose(x - away_m * math.cos(yaw), y - away_m * math.sin(yaw), 1.0, yaw=yaw)
    return world.picture(camera, FOV_RAD, HEIGHT, WIDTH)


@pytest.mark.parametrize("fog_m", [15.0, 40.0, 200.0])
def test_a_twentieth_of_the_contrast_is_left_at_the_optical_range(fog_m):
    picture = np.array([[(10, 10, 10), (250, 250, 250)]] * 3, np.uint8)
    away = np.array([[0.0] * 2, [fog_m / 2] * 2, [fog_m] * 2], np.float32)
    shown = fogged(picture, away, fog_m, AIR).astype(float)
    contrast = (shown[:, 1] - shown[:, 0]).mean(axis=1) / 240.0
    assert contrast == pytest.approx([1.0, math.sqrt(0.05), 0.05], abs=0.005)


def test_what_is_far_has_the_colour_of_the_fog():
    picture = np.zeros((1, 1, 3), np.uint8)
    assert fogged(picture, np.full((1, 1), 1e4, np.float32), 40.0, (0.2, 0.4, 0.6)).tolist() == [
        [[51, 102, 153]]
    ]


def test_the_ground_is_as_far_as_a_ray_down_to_it_and_a_wall_as_a_ray_to_it():
    scene = build_scene("simple_room", np.random.default_rng(0))
    away = background_m(Pose(z=1.0, pitch=math.radians(45.0)), FOV_RAD, 3, 3, scene)
    assert away[1, 1] == pytest.approx(math.sqrt(2.0), rel=1e-5)
    level = background_m(Pose(x=1.0, z=1.0), FOV_RAD, 3, 3, scene)
    assert level[1, 1] == pytest.approx(scene.half_x_m - 1.0, rel=1e-5)


def test_without_walls_the_sky_is_too_far_to_be_seen():
    scene = build_scene("urban_city", np.random.default_rng(0))
    assert scene.wall_height_m == 0.0
    assert background_m(Pose(z=1.0), FOV_RAD, 4, 4, scene)[0].min() > 1000.0


def test_a_person_in_fog_is_as_pale_as_their_distance_says_and_the_mask_is_as_without():
    clear, foggy = (
        World("simple_room", seed=5, obstacles=False, effects=Effects(fog_m=fog_m)) for fog_m in (0.0, 20.0)
    )
    air = 255.0 * np.array(foggy.scene.haze_rgb)
    for away_m in (2.0, 5.0):
        mask, bare = seen(clear, away_m=away_m)
        foggy_mask, pale = seen(foggy, away_m=away_m)
        np.testing.assert_array_equal(mask, foggy_mask)
        target = mask == MaskClass.TARGET
        assert target.sum() > 100
        left = (pale[target] - air).mean() / (bare[target] - air).mean()
        assert left == pytest.approx(0.05 ** (away_m / 20.0), rel=0.03)
