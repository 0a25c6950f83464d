"""Poses, masks, pictures and people of an engine's level are those of the world that it shows."""

from __future__ import annotations

import dataclasses
import json
import math
import threading

import gymnasium
import numpy as np
import pytest

from adatracker_deploy.cli import main
from adatracker_deploy.core.clock import MonotonicClock
from adatracker_deploy.core.errors import PlatformError, UsageError
from adatracker_deploy.core.geometry import Pose
from adatracker_deploy.core.messages import MaskClass, Twist
from adatracker_deploy.evaluation.grid import Grid
from adatracker_deploy.evaluation.play import play_all
from adatracker_deploy.learning.conditions import make_cell
from adatracker_deploy.learning.data.collect import collect
from adatracker_deploy.learning.data.recipe import load_recipe, parse_recipe
from adatracker_deploy.learning.tracking import Tracking
from adatracker_deploy.perception.jpeg import developed
from adatracker_deploy.perception.world_camera import WorldCamera
from adatracker_deploy.platform import CameraMount, Scenario
from adatracker_deploy.policy.base import to_twist
from adatracker_deploy.policy.catalogue import load_policy
from adatracker_deploy.sim.bodies import DriveSettings, KinematicBody
from adatracker_deploy.sim.rehearsal import Rehearsal
from adatracker_deploy.sim.studio import Studio, View
from adatracker_deploy.sim.world import World
from adatracker_deploy.sim.worlds import open_world
from tests.tiers import EXHAUSTIVE
from tests.unreal.server import RADIUS_M, TARGET, Game, Server

pytestmark = pytest.mark.slow

ROUNDING_M = 2e-5
"""The engine prints hundredths of a millimetre."""


def follow(spec, steps):
    """Follow with the PID; yield the episode and each tick."""
    tracking, policy = Tracking(spec, spec.task_settings(steps)), load_policy("pid")
    policy.reset(spec.seed)
    seen = tracking.begin()
    while True:
        tick = tracking.follow(to_twist(policy.act(seen).values, policy.info.action, tracking.limits))
        yield tracking, tick
        seen = tick.observation
        if tick.end:
            return


@EXHAUSTIVE
@pytest.mark.parametrize("condition", ["clean", "field"])
def test_the_grid_plays_with_the_built_in_worlds_poses_and_masks(serve, condition):
    plan = Grid(policies=("pid",), condition=condition, episodes=1, steps=4).plan()
    server = serve(episode.spec.world() for episode in plan)
    for episode in plan:
        spec = dataclasses.replace(episode.spec, scene=server.scene())
        for (there, tick), (here, own) in zip(follow(spec, 4), follow(episode.spec, 4), strict=True):
            world, body = server.game.world, there.task.body
            mask = world.render_mask(body.camera_pose, there.task.settings.fov_rad, 64, 64)
            np.testing.assert_array_equal(tick.truth.mask, mask)
            truth = world.truth(mask, body.pose, body.camera_pose, RADIUS_M)
            assert math.dist(tick.truth.target_xy, world.target_xy) < ROUNDING_M
            assert tick.truth.distance_m == pytest.approx(truth.distance_m, abs=2 * ROUNDING_M)
            assert tick.truth.contact == (None if truth.contact is None else "something")
            # And the whole episode is the one that a world built here would have been.
            assert math.dist(tick.truth.target_xy, own.truth.target_xy) < 1e-3
            ours, theirs = body.pose, here.task.body.pose
            assert math.dist((ours.x, ours.y), (theirs.x, theirs.y)) < 1e-3
            assert tick.reward == pytest.approx(own.reward, abs=1e-2)
            assert server.game.speeds[TARGET] == pytest.approx(100 * spec.target_speed_m_s)


@EXHAUSTIVE
def test_evaluate_plays_the_grid_through_a_server(serve, capsys):
    plan = Grid(policies=("pid",), episodes=1, steps=2).plan()
    server = serve(episode.spec.world() for episode in plan)
    arguments = ["--policy", "pid", "--episodes", "1", "--steps", "2", "--workers", "4", "--json"]
    assert main(["evaluate", "--scene", server.scene(), *arguments]) == 0
    (score,) = json.loads(capsys.readouterr().out)["policies"].values()
    there = [cell["episodes"][0]["ar"] for cell in score["cells"]]
    assert there == pytest.approx([played.ar for _, played in play_all(plan)], abs=1e-2)
    assert sum(f"vbp {TARGET} reset" == command for command in server.game.heard) == 16


def test_any_camera_sees_what_the_built_in_one_sees(serve):
    server = serve([World("urban_city", seed=4, others=3, path="random_walk")])
    world = open_world(server.scene(), seed=0, path="random_walk", others=3)
    own = server.game.world
    x, y = own.target_xy
    rng = np.random.default_rng(0)
    seen = set()
    for _ in range(6):
        yaw = float(rng.uniform(-math.pi, math.pi))
        eye = Pose(x - 4 * math.cos(yaw), y - 4 * math.sin(yaw), float(rng.uniform(0.3, 3.0)), 0.1, 0.2, yaw)
        mask, picture = world.render(eye, 1.4, 48, 64)
        expected, image = own.render(eye, 1.4, 48, 64)
        np.testing.assert_array_equal(mask, expected)
        np.testing.assert_array_equal(picture, image)
        seen |= set(np.unique(mask).tolist())
    assert {MaskClass.BACKGROUND, MaskClass.TARGET, MaskClass.OBSTACLE} <= seen


def test_the_game_moves_the_robot_where_it_cannot_be_and_follows_its_slopes(serve):
    server = serve([World("snow_village", seed=1, path="random_walk")])
    world = open_world(server.scene(), seed=0, path="random_walk")
    own, start = server.game.world, world.start
    ahead = Pose(start.x + 0.4, start.y, start.z, yaw=start.yaw + math.tau)
    there, expected = world.grounded(ahead, RADIUS_M), own.grounded(ahead, RADIUS_M)
    assert (there.pitch, there.z) != (0.0, start.z)
    np.testing.assert_allclose(there.translation(), expected.translation(), atol=ROUNDING_M)
    np.testing.assert_allclose(there.rotation(), expected.rotation(), atol=ROUNDING_M)
    wall = world.grounded(Pose(own.scene.half_x_m + 3, start.y), RADIUS_M)
    assert wall.x == pytest.approx(own.scene.half_x_m - RADIUS_M, abs=0.3)


def test_settings_place_people_where_the_seed_says(serve, tmp_path):
    file = tmp_path / "map.json"
    player = {"name": [TARGET], "class_name": ["bp_character_C"]}
    starts = [[100.0 * at, -50.0 * at, 87.5] for at in range(-3, 4)]
    file.write_text(json.dumps({"agents": {"player": player}, "safe_start": starts}))
    query = f"?settings={file}"
    server = serve([], query)
    at = [open_world(server.scene(query), seed=seed, path="still").target_xy for seed in (*range(9), 0)]
    assert at[0] == at[9]
    assert len(set(at)) > 2
    assert all((round(x), round(2 * y)) == (round(x), round(x)) for x, y in at)
    with pytest.raises(UsageError, match="8 people: the settings name 7 places to start"):
        open_world(server.scene(query), seed=1, path="random_walk", others=7)


@pytest.mark.parametrize(
    ("asked", "words"),
    [({"path": "u_turns"}, "walk by random_walk"), ({"crossing": 1, "path": "random_walk"}, "line of sight")],
)
def test_what_an_engines_people_cannot_do_is_refused(serve, asked, words):
    with pytest.raises(UsageError, match=words):
        open_world(serve([]).scene(), seed=0, others=1, **asked)


def test_a_game_that_ends_says_so_and_the_next_episode_connects_anew(serve):
    server = serve([])
    world = open_world(server.scene(), seed=0, path="random_walk")
    server.cut()
    with pytest.raises(PlatformError, match="the connection is lost"):
        world.step(0.1)
    again = open_world(server.scene(), seed=0, path="still")
    assert again.target_xy == pytest.approx(server.game.world.target_xy, abs=ROUNDING_M)


def test_gym_unrealcvs_names_make_the_toolkits_environment(serve):
    spec = make_cell("clean", 1.0, 1.0, 7)
    server = serve([spec.world()])
    server.game.level = "Arctic"  # as if it were open
    env = gymnasium.make(
        "adatracker_deploy.gym:UnrealTrack-Arctic-ContinuousColor-v0",
        server=f"127.0.0.1:{server.port}",
        height_m=1.0,
        target_speed_m_s=1.0,
    )
    image, _ = env.reset(seed=7)
    body = env.unwrapped.tracking.task.body
    expected = server.game.world.render(body.camera_pose, math.pi / 2, 64, 64)[1]
    np.testing.assert_array_equal(image, expected)
    image, reward, *_, info = env.step(np.zeros(2, np.float32))
    assert reward <= 1.0
    assert info["visible"]


def test_a_data_set_is_collected_in_a_level(serve, tmp_path):
    spec = make_cell("clean", 1.0, 1.0, 7)
    server = serve(spec.world() for _ in range(9))
    shipped = dataclasses.asdict(load_recipe("paper"))
    recipe = parse_recipe(shipped | {"scenes": {server.scene(): 1}}, where="test", name="engine")
    collect(recipe, tmp_path / "out", steps=6, workers=3)
    assert len(list((tmp_path / "out").glob("shard-*.npz"))) == 1
    assert f"vbp {TARGET} reset" in server.game.heard


def test_a_rehearsals_people_stand_until_they_may_go_and_then_walk_in_the_games_time(serve):
    server = serve([World("simple_room", seed=3, path="random_walk")])
    clock = server.game.clock
    studio = Studio(Scenario(scene=server.scene(), width_px=64), math.pi / 2)
    own = server.game.world
    robot = own.start
    camera = dataclasses.replace(robot, z=1.0)

    def target(going):
        clock.advance(0.1)
        frame = developed(studio.take(View(clock.now_ns(), robot, camera, going)))
        assert frame.rgb.shape == (48, 64, 3)
        return frame.truth.target_xy

    stood = [target(False) for _ in range(3)]
    assert stood[0] == stood[1] == stood[2]
    walked = [target(True) for _ in range(6)]
    assert math.dist(stood[0], walked[-1]) > 0.2
    assert math.dist(walked[-1], own.target_xy) < ROUNDING_M


def test_a_camera_of_a_trial_draws_the_level_from_the_robots_pose():
    """The trial's own: the process that draws is the server's client, and the clock the machine's."""
    game = Game([World("simple_room", seed=3, path="random_walk")], MonotonicClock())
    with Server(game) as server:
        scenario = Scenario(scene=server.scene(), width_px=64)
        camera = WorldCamera(scenario, CameraMount(up_m=1.0), lambda: Pose(5.0, 6.0), MonotonicClock(), 10.0)
        camera.open()
        try:
            frame = None
            while frame is None:
                frame = camera.read(0)
        finally:
            camera.close()
    assert frame.truth.distance_m == pytest.approx(2.5, abs=1e-3)
    assert math.dist(frame.truth.target_xy, game.world.target_xy) < ROUNDING_M
    assert MaskClass.TARGET in frame.truth.mask


def test_a_ground_robots_simulator_has_a_plain_of_its_own_and_the_levels_pictures():
    game = Game([World("simple_room", seed=3, path="random_walk")], MonotonicClock())
    with Server(game) as server:
        body = KinematicBody(DriveSettings(camera=CameraMount(up_m=1.0)))
        rehearsal = Rehearsal(Scenario(scene=server.scene(), width_px=64), body, math.pi / 2)
        rehearsal.step(Twist(vx=1.0), 0.1)
        assert 0.0 < body.pose.x < 0.2
        shots, got, ended = [], threading.Event(), threading.Event()

        def publish(shot):
            shots.append(shot)
            got.set()

        thread = rehearsal.film(MonotonicClock(), 10.0, publish, ended)
        assert got.wait(60)
        ended.set()
        thread.join(60)
    truth = developed(shots[0]).truth
    assert truth.distance_m == pytest.approx(2.5, abs=1e-3)
    assert MaskClass.TARGET in truth.mask


def test_a_level_without_anybody_to_follow_is_refused_and_the_server_is_free_again():
    game = Game([])
    del game.colours[TARGET]
    with Server(game) as server:
        for _ in range(2):
            with pytest.raises(UsageError, match=f"has no '{TARGET}' to follow; name the level's own file"):
                open_world(server.scene(), seed=0, path="random_walk")
