"""Pictures of the world, and the truth mask of the same pixels."""

from __future__ import annotations

import ctypes
import gc
import math
import multiprocessing
import platform
from concurrent.futures import ProcessPoolExecutor

import numpy as np
import pytest

from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.core.geometry import Pose
from adatracker_deploy.core.messages import MaskClass
from adatracker_deploy.sim import World, scene_names
from adatracker_deploy.sim.render import renderer
from adatracker_deploy.sim.render.figure import shipped_people
from benchmarks.perception import resident_mib
from tests.tiers import EXHAUSTIVE

pytest.importorskip("panda3d", reason="needs the extra 'world'")

FOV_RAD = math.radians(90.0)
HEIGHT, WIDTH = 120, 160


def behind(world, up_m=1.0, aside=0.0):
    x, y, yaw = world.start.x, world.start.y, world.start.yaw
    return Pose(x, y, world.start.z + up_m, yaw=yaw + aside)


def picture(world, camera=None, fov_rad=FOV_RAD):
    return world.picture(camera or behind(world), fov_rad, HEIGHT, WIDTH)


@pytest.mark.parametrize("scene", scene_names())
def test_every_scene_shows_the_target_ahead_on_a_ground_that_is_not_of_one_colour(scene):
    world = World(scene, seed=3, obstacles=False)
    mask, rgb = picture(world)
    rows, columns = np.nonzero(mask == MaskClass.TARGET)
    assert rgb.shape == (HEIGHT, WIDTH, 3)
    assert rgb.dtype == mask.dtype == np.uint8
    assert abs(columns.mean() - WIDTH / 2) < 6
    assert 0.3 * HEIGHT < np.ptp(rows) < 0.8 * HEIGHT  # somebody of 1.5 to 1.95 m at 2.5 m
    assert rgb[-10:].std() > 2.0
    assert set(np.unique(mask)) <= set(map(int, MaskClass))


def test_the_mask_is_the_people_s_to_the_pixel():
    """Without the people the picture differs where the mask has them, and hardly elsewhere."""
    world = World("simple_room", seed=4, obstacles=False, others=2)
    mask, rgb = picture(world)
    empty = World("simple_room", seed=4, obstacles=False, others=2)
    empty.picture(behind(empty), FOV_RAD, HEIGHT, WIDTH)
    for figure, shadow in zip(empty._renderer._figures, empty._renderer._shadows, strict=True):
        figure.root.hide()
        shadow.hide()
    _, bare = picture(empty, behind(world))
    changed = np.abs(rgb.astype(int) - bare).max(axis=2) > 12
    people = (mask == MaskClass.TARGET) | (mask == MaskClass.PERSON)
    assert changed[people].mean() > 0.8  # somebody may wear the wall's colour
    above = np.zeros_like(people)
    above[: HEIGHT // 2] = True  # shadows lie lower
    assert changed[~people & above].mean() < 0.005


def test_the_nearer_one_hides_who_is_behind():
    world = World("simple_room", seed=4, obstacles=False, others=1)
    x, y = world.target_xy
    other = world.people_xy[1]
    heading = math.atan2(*(other - (x, y))[::-1])
    before = Pose(x - 2 * math.cos(heading), y - 2 * math.sin(heading), 1.0, yaw=heading)
    mask, _ = picture(world, before)
    columns = np.nonzero(mask == MaskClass.TARGET)[1]
    assert len(columns) > 100
    assert not (mask[:, columns.min() + 3 : columns.max() - 3] == MaskClass.PERSON)[HEIGHT // 2 :].any()


def test_the_same_seed_shows_the_same_and_another_somebody_else():
    first, second, third = (picture(World("urban_city", seed=seed, obstacles=False)) for seed in (5, 5, 6))
    np.testing.assert_array_equal(first[0], second[0])
    np.testing.assert_array_equal(first[1], second[1])
    assert not np.array_equal(first[1], third[1])


@EXHAUSTIVE
def test_where_two_surfaces_are_equally_far_the_same_one_is_seen_each_time():
    """By Panda3D's own order of drawing, by address, pictures differed in one to three pixels of an edge."""
    for seed in range(20):
        before = picture(World("urban_city", seed=seed, obstacles=False))
        gc.collect()  # else the second world has the addresses of the first
        again = picture(World("urban_city", seed=seed, obstacles=False))
        np.testing.assert_array_equal(before[0], again[0])
        np.testing.assert_array_equal(before[1], again[1])


def test_turning_left_moves_the_target_right_and_a_wider_view_makes_it_smaller():
    world = World("simple_room", seed=3, obstacles=False)

    def target(**how):
        return np.nonzero(picture(world, **how)[0] == MaskClass.TARGET)

    assert target(camera=behind(world, aside=0.3))[1].mean() > target()[1].mean() + 10
    assert np.ptp(target(fov_rad=math.radians(110))[0]) < np.ptp(target()[0])


def test_two_worlds_in_one_process_do_not_show_in_each_other():
    ours, theirs = World("simple_room", seed=3, obstacles=False), World("snow_village", seed=8, others=3)
    alone = picture(ours)
    picture(theirs)
    for before, after in zip(alone, picture(ours), strict=True):
        np.testing.assert_array_equal(before, after)


def test_a_cast_plays_the_parts_and_the_target_is_the_first():
    """The first person of the cast plays the target, with any seed."""
    tall, short = shipped_people()[0], shipped_people()[5]
    heights = []
    for cast in ((tall,), (short,)):
        world = World("simple_room", seed=3, obstacles=False, cast=cast)
        heights.append(np.ptp(np.nonzero(picture(world)[0] == MaskClass.TARGET)[0]))
    assert heights[0] != heights[1]


def test_without_what_draws_it_is_said_what_to_install(monkeypatch):
    monkeypatch.setattr(renderer.importlib.util, "find_spec", lambda name: None)
    with pytest.raises(UsageError, match=r"need panda3d and panda3d-gltf: pip install .*\[world\]"):
        renderer.check_renderer()


def in_use_mib():
    """Return the resident memory after a world is seen and let go, less what malloc keeps for later."""
    World("parking_lot", seed=1, others=2).picture(Pose(z=1.0), 1.5, 480, 640)
    gc.collect()
    ctypes.CDLL(None).malloc_trim(0)
    return resident_mib()


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="needs glibc's malloc_trim")
def test_a_renderer_that_is_let_go_frees_its_scene():
    """Of 42 MiB; what is left, 2 MiB, are the rasteriser's own buffers."""
    # In a process of its own: what other tests' worlds left behind comes and goes by more than that.
    with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as process:
        *_, before = (process.submit(in_use_mib).result() for _ in range(3))
        *_, after = (process.submit(in_use_mib).result() for _ in range(6))
    assert after - before < 70.0
