from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from adatracker_deploy.core.geometry import Pose
from adatracker_deploy.core.messages import FILLED_M2, Box, MaskClass, covered
from adatracker_deploy.sim import World, scene_names
from adatracker_deploy.sim.camera import Camera, pixel_rays
from adatracker_deploy.sim.caster import Rays
from adatracker_deploy.sim.person import HEIGHT_M, Gait
from adatracker_deploy.sim.scene import Ground, Lap, Part, Scene, Thing
from adatracker_deploy.sim.stage import Stage

RIGHT_ANGLE = math.pi / 2
GREEN = (0.1, 0.8, 0.1)
GREY = (0.5, 0.5, 0.5)


def room(*things: Thing, wall_height_m: float = 0.0) -> Scene:
    return Scene(
        name="test",
        half_x_m=10.0,
        half_y_m=10.0,
        lap=Lap(straight_m=0.0, radius_m=5.0, waves=4),
        ground=Ground(rgb=GREY, other_rgb=GREY),
        things=things,
        wall_height_m=wall_height_m,
    )


def crate(x: float, y: float, height: float = 2.2) -> Thing:
    half = (0.4, 0.6, height / 2)
    return Thing(x=x, y=y, parts=(Part(shape="box", half=half, at=(0.0, 0.0, height / 2), rgb=GREEN),))


def camera(scene: Scene, *people: tuple[float, float]) -> Camera:
    stage = Stage(scene, obstacles=True, people=len(people))
    for index, (x, y) in enumerate(people):
        stage.move_person(index, (x, y, 0.0), 0.0, Gait())
    return Camera(scene, stage)


def test_rays_are_a_pinhole_with_square_pixels():
    rays = pixel_rays(RIGHT_ANGLE, 4, 8).T.reshape(4, 8, 3)
    on_plane = rays / rays[..., :1]
    assert np.linalg.norm(rays, axis=-1) == pytest.approx(1.0)
    assert on_plane[0, 0] == pytest.approx([1.0, 3.5 / 4, 1.5 / 4])
    assert on_plane[3, 7] == pytest.approx([1.0, -3.5 / 4, -1.5 / 4])


@pytest.mark.parametrize("distance", [2.0, 4.0, 7.0])
@pytest.mark.parametrize("height", [0.3, 1.0, 1.7])
def test_a_person_appears_where_a_pinhole_puts_them(distance, height):
    size = 320
    mask = camera(room(), (distance, 0.0)).mask(Pose(z=height), RIGHT_ANGLE, size, size)
    rows = np.flatnonzero((mask == MaskClass.TARGET).any(axis=1))
    focal = size / 2
    head = size / 2 - focal * (HEIGHT_M - height) / distance
    feet = size / 2 + focal * height / distance
    # A head reaches 0.1 m, a foot 0.2 m nearer than the middle of the person.
    assert rows[0] == pytest.approx(head, abs=2.0 + focal * 0.1 * abs(HEIGHT_M - height) / distance**2)
    assert rows[-1] + 1 == pytest.approx(min(feet, size), abs=2.0 + focal * 0.2 * height / distance**2)


@pytest.mark.parametrize("bearing_deg", [0, 25, -25])
@pytest.mark.parametrize("distance", [1.2, 1.0, 0.8, 0.6])
@pytest.mark.parametrize(
    ("height", "pitch_deg"), [(1.8, 20.0), (0.35, -10.0), (0.6, 0.0)], ids=["drone", "quadruped", "wheeled"]
)
def test_who_is_cut_off_is_not_farther_away_than_they_are(height, pitch_deg, distance, bearing_deg):
    bearing = math.radians(bearing_deg)
    at = distance * math.cos(bearing), distance * math.sin(bearing)
    target = (50.0, 0.0)
    mask = camera(room(), target, at).mask(Pose(z=height, pitch=math.radians(pitch_deg)), RIGHT_ANGLE, 48, 64)
    assert math.sqrt(FILLED_M2 / covered(mask)) < distance + 0.1


def test_left_is_left_and_pitch_down_moves_things_up():
    box = Box.of_mask(camera(room(), (4.0, 1.5)).mask(Pose(z=1.0), RIGHT_ANGLE, 64, 64))
    down = Box.of_mask(camera(room(), (4.0, 1.5)).mask(Pose(z=1.0, pitch=0.3), RIGHT_ANGLE, 64, 64))
    assert box.cx == pytest.approx(0.5 - 1.5 / 4.0 / 2, abs=0.03)
    assert down.cy < box.cy - 0.1


def test_an_obstacle_hides_the_person_behind_it():
    view = Pose(z=1.0)
    open_mask = camera(room(), (5.0, 0.0)).mask(view, RIGHT_ANGLE, 64, 64)
    hidden = camera(room(crate(3.0, 0.0)), (5.0, 0.0)).mask(view, RIGHT_ANGLE, 64, 64)
    low = camera(room(crate(3.0, 0.0, height=1.0)), (5.0, 0.0)).mask(view, RIGHT_ANGLE, 64, 64)
    assert (open_mask == MaskClass.TARGET).sum() > 20
    assert (hidden == MaskClass.TARGET).sum() == 0
    assert (hidden == MaskClass.OBSTACLE).sum() > 100
    assert 0 < (low == MaskClass.TARGET).sum() < (open_mask == MaskClass.TARGET).sum()


def test_a_wall_hides_the_person_behind_it_and_is_background():
    outside = Pose(x=-14.0, z=1.0)
    mask = camera(room(wall_height_m=3.0), (-5.0, 0.0)).mask(outside, RIGHT_ANGLE, 64, 64)
    assert (mask == MaskClass.BACKGROUND).all()


def test_another_person_hides_the_target_as_a_person():
    mask = camera(room(), (5.0, 0.0), (2.5, 0.0)).mask(Pose(z=1.0), RIGHT_ANGLE, 64, 64)
    assert mask[32, 32] == MaskClass.PERSON


def test_colours_and_classes_belong_to_the_same_things():
    seen = camera(room(crate(4.0, 2.0), crate(6.0, -3.0)), (4.0, 0.0), (5.0, 1.5))
    mask, rgb = seen.image(Pose(z=1.2), RIGHT_ANGLE, 160, 160)
    red, green, blue = (rgb[..., channel].astype(int) for channel in range(3))
    greenish = (green > red + 40) & (green > blue + 40)
    assert (greenish == (mask == MaskClass.OBSTACLE)).mean() > 0.999
    shirt = (red > green + 60) & (red > blue + 60)
    assert shirt.sum() > 50
    assert (mask[shirt] == MaskClass.TARGET).all()


@pytest.mark.parametrize("name", scene_names())
def test_every_pixel_has_the_class_of_what_stands_at_the_place_it_shows(name):
    world = World(name, seed=1, others=2)
    view = world.start @ Pose(z=1.2)
    mask = world.render_mask(view, RIGHT_ANGLE, 48, 48).reshape(-1)
    ways = view.rotation() @ pixel_rays(RIGHT_ANGLE, 48, 48)
    distance = world._stage.solids(Rays(view.translation(), ways)).distance
    solids = world.scene.free_space(obstacles=True)
    near = {MaskClass.TARGET: world.people_xy[:1], MaskClass.PERSON: world.people_xy[1:]}
    assert (mask == MaskClass.TARGET).any()
    assert (mask == MaskClass.OBSTACLE).any()
    for pixel, hit in enumerate(np.where(np.isfinite(distance), distance, 0.0)):
        x, y, z = view.translation() + ways[:, pixel] * hit
        if mask[pixel] in near:
            assert np.hypot(*(near[mask[pixel]] - (x, y)).T).min() < 0.6
        elif mask[pixel] == MaskClass.OBSTACLE:
            assert solids.touches(x, y, z, 1e-6)


@settings(max_examples=25, deadline=None)
@given(
    name=st.sampled_from(scene_names()),
    seed=st.integers(0, 1000),
    up=st.floats(0.2, 6.0),
    pitch=st.floats(-0.5, 1.2),
    turn=st.floats(-3.0, 3.0),
)
def test_the_fast_mask_is_the_image_s_mask(name, seed, up, pitch, turn):
    world = World(name, seed=seed, others=1)
    view = world.start @ Pose(z=up, pitch=pitch, yaw=turn)
    mask, rgb = world.render(view, 1.2, 24, 32)
    assert rgb.shape == (24, 32, 3)
    assert rgb.dtype == mask.dtype == np.uint8
    assert np.array_equal(mask, world.render_mask(view, 1.2, 24, 32))


@pytest.mark.parametrize("name", scene_names())
def test_no_ray_that_meets_something_is_left_out(name, monkeypatch):
    world = World(name, seed=2, others=2)
    views = [world.start @ Pose(z=1.0, yaw=turn) for turn in (0.0, 1.5, 3.0)]
    culled = [world.render_mask(view, 2.0, 48, 48) for view in views]
    everything = lambda self, rays: enumerate(np.ones((len(self._solids), len(rays)), bool))  # noqa: E731
    monkeypatch.setattr(Stage, "_near", everything)
    for view, mask in zip(views, culled, strict=True):
        assert np.array_equal(mask, world.render_mask(view, 2.0, 48, 48))


def test_things_throw_a_shadow_away_from_the_sun():
    plain, shaded = (
        camera(scene, (8.0, 8.0)).image(Pose(x=-3.0, z=6.0, pitch=RIGHT_ANGLE), RIGHT_ANGLE, 64, 64)[1]
        for scene in (room(), room(crate(-3.0, 0.0)))
    )
    assert shaded[20:44, 20:44].mean() < plain[20:44, 20:44].mean() - 5
