"""A robot in its world: it is carried and blocked by it, and filmed together with the truth."""

from __future__ import annotations

import math
import threading
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from adatracker_deploy.core.clock import FakeClock
from adatracker_deploy.core.geometry import Pose
from adatracker_deploy.core.messages import MaskClass, Shot, Truth, Twist
from adatracker_deploy.perception.jpeg import developed
from adatracker_deploy.platform import CameraMount, Scenario
from adatracker_deploy.sim.bodies import DriveSettings, KinematicBody
from adatracker_deploy.sim.filming import film
from adatracker_deploy.sim.rehearsal import Rehearsal
from adatracker_deploy.sim.studio import Studio, View

FOV_RAD = math.radians(90)
STEP_S = 0.05
STEP_NS = 50_000_000
AHEAD = Twist(vx=1.0)


WIDTH_PX = 96


class Stage(Rehearsal):
    """A rehearsal with its studio in the same process."""

    def __init__(self, scenario, body):
        super().__init__(scenario, body, FOV_RAD)
        self._studio = Studio(scenario, FOV_RAD)

    def look(self, now_ns):
        return developed(self._studio.take(self.view(now_ns)))


def rehearsal(**scenario):
    body = KinematicBody(DriveSettings(camera=CameraMount(up_m=0.5)))
    return Stage(Scenario(**scenario, width_px=WIDTH_PX), body), body


def test_the_robot_starts_2_5_m_behind_the_target_and_sees_it():
    frame = rehearsal()[0].look(STEP_NS)
    assert frame.rgb.shape == (72, 96, 3)
    assert frame.truth.mask.shape == (72, 96)
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
    ended, frames = threading.Event(), []

    def publish(frame):
        frames.append(frame)
        if len(frames) == 5:
            ended.set()

    rehearsal()[0].film(FakeClock(), 20.0, publish, ended).join(20)
    assert [frame.seq for frame in frames] == [1, 2, 3, 4, 5]
    assert {b.t_ns - a.t_ns for a, b in pairwise(frames)} == {STEP_NS}


NOTHING = Truth(
    mask=np.zeros((2, 2), np.uint8),
    robot=Pose(),
    camera=Pose(),
    target_xy=(0.0, 0.0),
    distance_m=0.0,
    bearing_rad=0.0,
)


class Painter:
    """Implements `Drawing`: as many pictures as it is told, of nothing."""

    def __init__(self, pictures):
        self.left, self.closed = pictures, False

    def take(self, view, ended):
        if not self.left:
            raise EOFError
        self.left -= 1
        return Shot(b"", view.t_ns, view.t_ns, NOTHING)

    def close(self):
        self.closed = True


def test_what_draws_is_closed_however_the_film_ends():
    painter, frames = Painter(3), []
    with pytest.raises(EOFError):
        film(painter, seen_from_here, FakeClock(), 20.0, frames.append, ended=threading.Event())
    assert len(frames) == 3
    assert painter.closed


def test_nothing_is_drawn_before_there_is_a_view():
    painter, frames, asked = Painter(1), [], []

    def later(t_ns):
        asked.append(t_ns)
        return seen_from_here(t_ns) if len(asked) > 3 else None

    with pytest.raises(EOFError):
        film(painter, later, FakeClock(), 20.0, frames.append, ended=threading.Event())
    assert [frame.t_ns for frame in frames] == [asked[3]]


def seen_from_here(t_ns):
    return View(t_ns, Pose(), Pose(), going=False)


def test_in_its_own_frame_a_robot_begins_where_it_is_wherever_that_is():
    own = Studio(Scenario(seed=3, width_px=WIDTH_PX), FOV_RAD, own_frame=True)
    hovering = Pose(100.0, -40.0, 2.0, yaw=2.0)
    first = own.take(View(0, hovering, hovering, going=False)).truth
    assert first.distance_m == pytest.approx(2.5, abs=0.05)
    assert first.bearing_rad == pytest.approx(0.0, abs=0.02)
    turned = replace(hovering, yaw=hovering.yaw + 0.3)
    second = own.take(View(STEP_NS, turned, turned, going=False)).truth
    assert second.bearing_rad == pytest.approx(-0.3, abs=0.02)
    below = hovering @ Pose(x=2.5, z=-1.0)
    assert own.take(View(2 * STEP_NS, below, below, going=False)).truth.contact == "the target"


@pytest.mark.parametrize(("yaw", "in_view"), [(0.0, True), (0.7, True), (1.2, False), (3.1, False)])
def test_who_is_outside_the_picture_is_not_in_view(yaw, in_view):
    eye = Studio(Scenario(seed=3, width_px=WIDTH_PX), FOV_RAD, own_frame=True)
    eye.take(seen_from_here(0))
    turned = Pose(z=1.0, yaw=yaw)
    truth = eye.take(View(STEP_NS, turned, turned, going=False)).truth
    assert truth.in_view is in_view
    assert (MaskClass.TARGET in truth.mask) is in_view
