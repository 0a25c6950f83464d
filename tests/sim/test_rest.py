"""People sit down by themselves, stay for a while and stand up; in masks and in pictures."""

from __future__ import annotations

import math

import numpy as np
import pytest

from adatracker_deploy.config.effects import Effects
from adatracker_deploy.core.geometry import Pose
from adatracker_deploy.core.messages import MaskClass
from adatracker_deploy.sim import World
from adatracker_deploy.sim.person import HEIGHT_M, Gait, posture
from adatracker_deploy.sim.rest import DOWN_S, MOVE_S, Rest

pytest.importorskip("panda3d", reason="needs the extra 'world'")

DT_S = 0.1
FOV_RAD = math.radians(90.0)


def lived(seconds, seed=0):
    rest = Rest(np.random.default_rng(seed))
    states = []
    for _ in range(round(seconds / DT_S)):
        rest.step(DT_S)
        states.append((rest.walking, rest.seated))
    return states


def test_somebody_sits_down_stays_and_stands_up_without_a_jump():
    states = lived(600.0)
    seated = np.array([share for _, share in states])
    assert np.abs(np.diff(seated)).max() <= DT_S / MOVE_S + 1e-9
    assert seated.max() == 1.0
    assert all(share == 0.0 for walking, share in states if walking)
    whole = "".join("s" if share == 1.0 else "." for _, share in states).split(".")
    stays_s = [len(stay) * DT_S for stay in whole if stay][:-1]
    assert len(stays_s) > 5
    assert min(stays_s) >= DOWN_S[0] - 2 * DT_S
    assert max(stays_s) <= DOWN_S[1] + 2 * DT_S


def test_a_seated_body_is_lower_its_thighs_are_level_and_its_feet_where_they_were():
    up, down = (posture(Gait(seated=seated))[0] for seated in (0.0, 1.0))
    assert up[0, 2] - down[0, 2] == pytest.approx(0.245 * HEIGHT_M, abs=0.03)  # by a thigh's length
    feet = [-1, 9]
    np.testing.assert_allclose(up[feet, 2], down[feet, 2], atol=1e-6)


def test_who_sits_does_not_walk_and_everybody_sits_sometimes():
    world = World("simple_room", seed=2, obstacles=False, others=2, effects=Effects(sit=True))
    sat = np.zeros(3, bool)
    for _ in range(600):
        before = world.people_xy
        was_down = [not rest.walking for rest in world._rests]
        world.step(DT_S)
        still = [not rest.walking and down for rest, down in zip(world._rests, was_down, strict=True)]
        np.testing.assert_array_equal(world.people_xy[still], before[still])
        sat |= [rest.seated == 1.0 for rest in world._rests]
    assert sat.all()


def test_people_walk_the_same_ways_where_nobody_sits():
    plain, effects = (
        World("simple_room", seed=2, others=1),
        World("simple_room", seed=2, others=1, effects=Effects(fog_m=40.0)),
    )
    for world in (plain, effects):
        world.step(3.0)
    np.testing.assert_array_equal(plain.people_xy, effects.people_xy)


def test_a_seated_target_is_lower_in_masks_and_in_pictures_and_has_a_seat_there():
    world = World("simple_room", seed=5, obstacles=False, path="still", effects=Effects(sit=True))
    x, y = world.target_xy
    yaw = world.start.yaw
    camera = Pose(x - 3.0 * math.cos(yaw), y - 3.0 * math.sin(yaw), 1.0, yaw=yaw)

    def tops():
        drawn, _ = world.picture(camera, FOV_RAD, 240, 320)
        cast = world.render_mask(camera, FOV_RAD, 240, 320)
        seats = int((drawn == MaskClass.OBSTACLE).sum())
        return [int(np.nonzero(mask == MaskClass.TARGET)[0].min()) for mask in (drawn, cast)], seats

    up, no_seat = tops()
    for _ in range(1200):
        world.step(DT_S)
        if world._rests[0].seated == 1.0:
            break
    down, seat = tops()
    assert all(low - high > 10 for low, high in zip(down, up, strict=True))
    assert no_seat == 0
    assert seat > 50
    while world._rests[0].seated:
        world.step(DT_S)
    assert tops()[1] == 0
