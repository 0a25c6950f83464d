"""A robot in its world: it is carried and blocked by it, and filmed together with the truth."""

from __future__ import annotations

import math
import threading
from itertools import pairwise

import numpy as np
import pytest

from adatracker_deploy.core.clock import FakeClock
from adatracker_deploy.core.messages import MaskClass, Twist
from adatracker_deploy.platform import CameraMount, Scenario
from adatracker_deploy.sim.bodies import DriveSettings, KinematicBody
from adatracker_deploy.sim.rehearsal import Rehearsal, Studio, film

FOV_RAD = math.radians(90)
STEP_S = 0.05
STEP_NS = 50_000_000
AHEAD = Twist(vx=1.0)


SIZE = (96, 64)


class Stage(Rehearsal):
    """A rehearsal with its studio in the same process."""

    def __init__(self, scenario, body):
        super().__init__(scenario, body, FOV_RAD, SIZE)
        self._studio = Studio(scenario, FOV_RAD, SIZE)

    def look(self, now_ns):
        return self._studio.take(self.view(now_ns))


def rehearsal(**scenario):
    body = KinematicBody(DriveSettings(camera=CameraMount(up_m=0.5)))
    return Stage(Scenario(**scenario), body), body


def test_the_robot_starts_2_5_m_behind_the_target_and_sees_it():
    frame = rehearsal()[0].look(STEP_NS)
    assert frame.rgb.shape == (64, 96, 3)
    assert frame.truth.mask.shape == (64, 96)
    assert (frame.t_ns, frame.seq) == (STEP_NS, 1)
    assert frame.truth.distance_m == pytest.approx(2.5, abs=0.05)
    assert frame.truth.bearing_rad == pytest.approx(0.0, abs=0.02)
    assert MaskClass.TARGET in frame.truth.mask


def test_people_stand_until_they_may_go_and_then_walk_in_the_runs_time():
    stage, _ = rehearsal(target_speed_m_s=1.0)
    stood = [stage.look(t * STEP_NS).truth.target_xy for t in range(5)]
    assert len(set(stood)) == 1
    stage.go()
    stage.look(100 * STEP_NS)
    walked = stage.look(120 * STEP_NS).truth.target_xy
    assert math.dist(walked, stood[0]) == pytest.approx(1.0, abs=0.1)


def test_the_body_follows_its_commands_and_the_camera_follows_the_body():
    stage, _ = rehearsal()
    before = stage.look(0).truth
    for _ in range(20):
        stage.step(AHEAD, STEP_S)
    after = stage.look(STEP_NS).truth
    assert math.dist((before.robot.x, before.robot.y), (after.robot.x, after.robot.y)) == pytest.approx(
        1.0, abs=0.05
    )
    assert after.distance_m == pytest.approx(before.distance_m - 1.0, abs=0.1)
    assert after.camera.z == pytest.approx(after.robot.z + 0.5, abs=0.05)


def test_walls_stop_a_robot_that_drives_on_for_ever():
    stage, body = rehearsal()
    for _ in range(2000):
        stage.step(AHEAD, STEP_S)
    at = body.pose
    for _ in range(100):
        stage.step(AHEAD, STEP_S)
    assert math.hypot(body.pose.x - at.x, body.pose.y - at.y) < 0.5


def test_the_same_seed_and_calls_give_the_same_film():
    def shot(seed):
        stage, _ = rehearsal(seed=seed)
        stage.go()
        for t in range(10):
            stage.step(AHEAD, STEP_S)
            frame = stage.look(t * STEP_NS)
        return frame

    assert np.array_equal(shot(3).rgb, shot(3).rgb)
    assert shot(3).truth.target_xy == shot(3).truth.target_xy
    assert not np.array_equal(shot(3).rgb, shot(4).rgb)


class Jostled(KinematicBody):
    """Somebody drives it on as soon as its pose has been read, unless kept from it."""

    drive_on = None

    @property
    def pose(self):
        pose = super().pose
        drive_on, self.drive_on = self.drive_on, None
        if drive_on is not None:
            driving = threading.Thread(target=drive_on)
            driving.start()
            driving.join(0.2)
        return pose


def test_driving_and_filming_at_once_never_show_half_a_step():
    body = Jostled(DriveSettings(camera=CameraMount(up_m=0.5)))
    stage = Stage(Scenario(), body)
    body.drive_on = lambda: stage.step(AHEAD, 1.0)
    truth = stage.look(STEP_NS).truth
    mounted = body.settings.camera.pose(truth.robot)
    assert (truth.camera.x, truth.camera.y) == (mounted.x, mounted.y)


def test_a_film_has_its_rate_in_the_runs_time_and_ends_when_it_is_told():
    stage, _ = rehearsal()
    ended, frames = threading.Event(), []

    def publish(frame):
        frames.append(frame)
        if len(frames) == 5:
            ended.set()

    film(stage, FakeClock(), 20.0, publish, ended).join(20)
    assert [frame.seq for frame in frames] == [1, 2, 3, 4, 5]
    assert {b.t_ns - a.t_ns for a, b in pairwise(frames)} == {STEP_NS}
