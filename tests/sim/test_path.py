from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from adatracker_deploy.core.geometry import wrap_angle
from adatracker_deploy.sim.path import (
    BERTH_M,
    TURN_RATE_RAD_S,
    Crosser,
    RandomWalk,
    SPath,
    Still,
    UTurnWalk,
    lap_course,
)
from adatracker_deploy.sim.scene import Lap
from adatracker_deploy.sim.scenes import build_scene, scene_names

SEEDS = st.integers(0, 2**32 - 1)


def scene(name: str, seed: int = 0):
    return build_scene(name, np.random.default_rng(seed))


def everywhere(points):
    return np.full(len(points), np.inf)


@pytest.mark.parametrize("name", scene_names())
@settings(max_examples=20, deadline=None)
@given(seed=SEEDS)
def test_every_s_path_keeps_clear_of_walls_and_things(name, seed):
    place = scene(name, seed)
    assert place.free_space(obstacles=True).clearance(lap_course(place.lap)).min() >= 2 * BERTH_M


@pytest.mark.parametrize("name", scene_names())
def test_an_s_path_goes_round_for_ever_at_constant_speed_and_turns_smoothly(name):
    course = lap_course(scene(name).lap)
    walker = SPath(course, 1.5, start_m=3.0)
    steps, turns = [], []
    for _ in range(int(1.2 * walker.length_m / 0.15)):
        x, y, heading = walker.x, walker.y, walker.heading
        walker.step(0.1, everywhere)
        steps.append(math.dist((x, y), (walker.x, walker.y)))
        turns.append(abs(wrap_angle(walker.heading - heading)))
    assert steps == pytest.approx([0.15] * len(steps), rel=0.01)
    assert max(turns) < 0.15 / 1.4, "no curve is tighter than 1.4 m"


def test_an_s_path_bends_to_both_sides():
    walker = SPath(lap_course(Lap(straight_m=0.0, radius_m=6.0, waves=4)), 1.0, start_m=0.0)
    turns = []
    for _ in range(400):
        heading = walker.heading
        walker.step(0.1, everywhere)
        turns.append(wrap_angle(walker.heading - heading))
    assert min(turns) < -0.01
    assert max(turns) > 0.01


def test_the_heading_is_where_the_next_step_leads():
    walker = SPath(lap_course(scene("simple_room").lap)[::-1], 1.0, start_m=10.0)
    for _ in range(500):
        x, y, heading = walker.x, walker.y, walker.heading
        walker.step(0.02, everywhere)
        assert abs(wrap_angle(math.atan2(walker.y - y, walker.x - x) - heading)) < 0.03


@pytest.mark.parametrize("name", scene_names())
@settings(max_examples=8, deadline=None)
@given(seed=SEEDS, speed=st.floats(0.3, 3.0))
def test_a_random_walk_stays_clear_turns_slowly_and_gets_about(name, seed, speed):
    space = scene(name, seed).free_space(obstacles=True, inset_m=1.5)
    rng = np.random.default_rng(seed)
    x, y = space.push_out(0.0, 6.0, 1.0)
    walker = RandomWalk(x, y, 0.0, speed_m_s=speed, rng=rng)
    walked = 0.0
    for _ in range(200):
        x, y, heading = walker.x, walker.y, walker.heading
        walker.step(0.1, space.clearance)
        walked += math.dist((x, y), (walker.x, walker.y))
        assert space.clearance(np.array([[walker.x, walker.y]]))[0] >= BERTH_M
        assert abs(wrap_angle(walker.heading - heading)) <= TURN_RATE_RAD_S * 0.1 + 1e-9
    assert walked >= 0.6 * speed * 20.0


@settings(max_examples=10, deadline=None)
@given(seed=SEEDS, speed=st.floats(0.5, 3.0))
def test_somebody_who_turns_round_does_so_every_few_seconds_and_stays_clear(seed, speed):
    space = scene("simple_room", seed).free_space(obstacles=True, inset_m=1.5)
    x, y = space.push_out(0.0, 6.0, 1.0)
    walker = UTurnWalk(x, y, 0.0, speed_m_s=speed, rng=np.random.default_rng(seed))
    headings = []
    for _ in range(1200):
        walker.step(0.1, space.clearance)
        headings.append(walker.heading)
        assert space.clearance(np.array([[walker.x, walker.y]]))[0] >= BERTH_M
    within_2_s = [abs(wrap_angle(b - a)) for a, b in zip(headings, headings[20:], strict=False)]
    assert np.mean(np.array(within_2_s) > math.radians(140)) > 0.05


def test_a_crosser_gets_between_an_eye_and_what_it_looks_at():
    walker = Crosser(0.0, 4.0, 0.0, speed_m_s=1.0, rng=np.random.default_rng(0))
    nearest = math.inf
    for _ in range(600):
        walker.meet((-1.25, 0.0), (1.25, 0.0), 0.1)
        walker.step(0.1, everywhere)
        nearest = min(nearest, math.hypot(walker.x, walker.y))
    assert nearest < 0.6


def test_a_walker_waits_for_what_stands_in_its_way_and_then_goes_on():
    walker = SPath(lap_course(scene("simple_room").lap), 1.0, start_m=0.0)
    ahead = np.array([walker.x + math.cos(walker.heading), walker.y + math.sin(walker.heading)])

    def blocked(points):
        return np.hypot(*(points - ahead).T)

    for _ in range(50):
        walker.step(0.1, blocked)
    stopped = (walker.x, walker.y)
    assert BERTH_M <= math.dist(stopped, ahead) <= BERTH_M + 0.15
    walker.step(0.1, everywhere)
    assert math.dist(stopped, (walker.x, walker.y)) == pytest.approx(0.1, rel=0.01)


def test_somebody_who_stands_stays():
    walker = Still(1.0, 2.0, 0.5)
    walker.step(1.0, everywhere)
    assert (walker.x, walker.y, walker.heading) == (1.0, 2.0, 0.5)
