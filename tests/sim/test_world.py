from __future__ import annotations

import math
import subprocess
import sys

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.core.geometry import Pose
from adatracker_deploy.core.messages import Box, MaskClass
from adatracker_deploy.sim import World, check_scene, describe_scenes, scene_names
from adatracker_deploy.sim.path import BERTH_M

SEEDS = st.integers(0, 2**31 - 1)
PATHS = st.sampled_from(["s_path", "random_walk", "still"])
SCENES = st.sampled_from(scene_names())


def test_unknown_names_are_refused_with_the_known_ones():
    with pytest.raises(UsageError, match=r"unknown scene 'moon': known are simple_room, parking_lot"):
        World("moon", seed=0)
    with pytest.raises(UsageError, match="unknown scene"):
        check_scene("moon")
    with pytest.raises(UsageError, match="unknown path 'teleport': known are s_path"):
        World("simple_room", seed=0, path="teleport")


def test_every_scene_is_described():
    assert list(describe_scenes()) == scene_names()
    for name in scene_names():
        check_scene(name)


def test_the_simulator_is_imported_only_when_a_world_is_built():
    code = "import sys, adatracker_deploy.sim.episode; sys.exit('mujoco' in sys.modules)"
    subprocess.run([sys.executable, "-c", code], check=True)


@settings(max_examples=30, deadline=None)
@example(name="parking_lot", seed=387, path="s_path", obstacles=False)  # once began in somebody's shoes
@given(name=SCENES, seed=SEEDS, path=PATHS, obstacles=st.booleans())
def test_a_robot_starts_on_free_ground_and_sees_the_target_straight_ahead_at_2_5_m(
    name, seed, path, obstacles
):
    world = World(name, seed=seed, path=path, obstacles=obstacles, others=1)
    start = world.start
    assert start.distance_to(*world.target_xy) == pytest.approx(2.5, abs=1e-6)
    assert start.bearing_to(*world.target_xy) == pytest.approx(0.0, abs=1e-6)
    assert start.z == world.ground_z(start.x, start.y)
    assert world.contact(start.x, start.y, start.z, 0.3) is None
    box = Box.of_mask(world.render_mask(start @ Pose(z=1.0), math.pi / 2, 64, 64))
    assert box is not None
    assert box.cx == pytest.approx(0.5, abs=0.06)


def masks(seed: int) -> list[np.ndarray]:
    world = World("simple_room", seed=seed, path="random_walk", others=2)
    seen = []
    for _ in range(15):
        world.step(0.1, world.start)
        seen.append(world.render_mask(world.start @ Pose(z=1.0), math.pi / 2, 48, 48))
    return seen


@settings(max_examples=5, deadline=None)
@given(seed=SEEDS)
def test_the_same_seed_gives_the_same_masks_bit_for_bit(seed):
    assert np.array_equal(masks(seed), masks(seed))


def test_another_seed_gives_another_world():
    assert not np.array_equal(masks(1), masks(2))


@settings(max_examples=10, deadline=None)
@given(name=SCENES, seed=SEEDS, path=PATHS)
def test_nobody_walks_through_things_or_through_anybody(name, seed, path):
    world = World(name, seed=seed, target_speed_m_s=1.5, path=path, others=3)
    free = world.scene.free_space(obstacles=True)
    for _ in range(100):
        world.step(0.1)
        people = world.people_xy
        assert free.clearance(people).min() >= 0.5
        apart = np.hypot(*(people[:, None] - people[None]).transpose(2, 0, 1)) + 9 * np.eye(len(people))
        assert apart.min() >= BERTH_M


@pytest.mark.parametrize("height_m", [0.0, 1.72, 2.0], ids=["on the ground", "head", "just above"])
def test_the_target_does_not_walk_through_a_robot_that_blocks_its_way(height_m):
    world = World("simple_room", seed=3, obstacles=False)
    x, y = world.target_xy
    robot = world.start @ Pose(x=4.5, z=height_m)
    for _ in range(60):
        world.step(0.1, robot)
        assert world.contact(robot.x, robot.y, robot.z, 0.3) is None
    assert robot.distance_to(*world.target_xy) >= BERTH_M
    overhead = Pose(robot.x, robot.y, 2.5)
    for _ in range(60):
        world.step(0.1, overhead)
    assert math.dist((x, y), world.target_xy) > 4.0


def test_a_long_step_walks_as_far_as_many_short_ones():
    long, short = (World("simple_room", seed=5, obstacles=False) for _ in range(2))
    long.step(1.0)
    for _ in range(100):
        short.step(0.01)
    assert long.target_xy == pytest.approx(short.target_xy, abs=1e-9)


def test_no_time_changes_nothing():
    world = World("simple_room", seed=5)
    before = world.target_xy
    world.step(0.0)
    assert world.target_xy == before


def test_walls_people_and_obstacles_collide_at_their_height():
    world, empty = World("simple_room", seed=7, others=2), World("simple_room", seed=7, obstacles=False)
    for (x, y), name in zip(world.people_xy, ("the target", "another person", "another person"), strict=True):
        assert world.contact(x, y, 1.0, 0.1) == name
        assert world.contact(x + 0.5, y, 1.0, 0.3) == name
        assert world.contact(x, y, 2.2, 0.3) is None
    assert world.contact(world.scene.half_x_m, 0.0, 1.0, 0.3) == "an obstacle"
    for thing in world.scene.things:
        assert world.contact(thing.x, thing.y, 0.0, 0.1) == "an obstacle"
        assert empty.contact(thing.x, thing.y, 0.0, 0.1) is None


@settings(max_examples=30, deadline=None)
@given(name=SCENES, x=st.floats(-30, 30), y=st.floats(-30, 30), yaw=st.floats(-3, 3))
def test_a_ground_body_is_kept_out_of_things_and_on_the_ground(name, x, y, yaw):
    world = World(name, seed=0)
    pose = world.grounded(Pose(x, y, 5.0, yaw=yaw), 0.3)
    assert pose.yaw == yaw
    assert pose.z == world.ground_z(pose.x, pose.y)
    assert world.scene.free_space(obstacles=True).clearance(np.array([[pose.x, pose.y]]))[0] >= 0.3 - 1e-3


def test_people_stand_on_the_terrain():
    world = World("snow_village", seed=0, path="still")
    x, y = world.target_xy
    ground = world.ground_z(x, y)
    view = Pose(world.start.x, world.start.y, ground + 0.9, yaw=world.start.yaw)
    rows = np.flatnonzero((world.render_mask(view, math.pi / 2, 200, 200) == MaskClass.TARGET).any(axis=1))
    top = ground + 0.9 + (100 - rows[0]) / 100 * 2.5
    assert top == pytest.approx(ground + 1.75, abs=0.06)


def test_truth_says_where_the_target_is():
    world = World("simple_room", seed=0)
    robot = Pose(world.start.x, world.start.y, yaw=world.start.yaw - 0.3)
    mask = world.render_mask(robot @ Pose(z=1.0), math.pi / 2, 32, 32)
    truth = world.truth(mask, robot, robot @ Pose(z=1.0), 0.3)
    assert truth.distance_m == pytest.approx(2.5)
    assert truth.bearing_rad == pytest.approx(0.3)
    assert truth.target_xy == world.target_xy
    assert truth.contact is None


def test_people_who_cross_hide_the_target_from_a_robot_more_often_than_others_do():
    def hidden(crossing: int) -> int:
        count = 0
        for seed in range(4):
            world = World(
                "simple_room", seed=seed, path="still", others=2, crossing=crossing, obstacles=False
            )
            start = world.start
            for _ in range(150):
                world.step(0.2, start)
                mask = world.render_mask(start @ Pose(z=1.0), math.pi / 2, 32, 32)
                count += Box.of_mask(mask) is None or (mask[:, 14:18] == MaskClass.PERSON).any()
        return count

    assert hidden(crossing=2) > 2 * hidden(crossing=0)
