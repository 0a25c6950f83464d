"""The world of a ground robot's simulator: one robot, people and obstacles.

`Rehearsal` is the robot's half: the protocol thread drives the body, which obstacles and walls block.
`Studio` is the camera's half: the people and the images. `film` renders in its own process, because on a busy
machine rendering would otherwise delay the protocol thread, which has only milliseconds.
"""

from __future__ import annotations

import contextlib
import multiprocessing
import signal
import threading
from typing import TYPE_CHECKING, NamedTuple

import cv2
import numpy as np

from adatracker_deploy.core.geometry import Pose
from adatracker_deploy.core.messages import Frame
from adatracker_deploy.runtime.pacer import Pacer
from adatracker_deploy.sim.world import World

if TYPE_CHECKING:
    from collections.abc import Callable
    from multiprocessing.connection import Connection

    from adatracker_deploy.core.clock import Clock
    from adatracker_deploy.core.messages import Twist
    from adatracker_deploy.platform import Scenario
    from adatracker_deploy.sim.bodies import GroundBody

BODY_RADIUS_M = 0.3
"""Radius within which an obstacle counts as a collision and blocks the body."""
LOOK_S = 0.05
"""Interval at which a thread waiting for an image checks whether rendering has ended."""
RGB_SHARE = 2
"""Colours, which only people look at, are rendered at half the resolution in a third of the time, so that a
rehearsal at five times real time keeps up."""


def take_frame(
    world: World, robot: Pose, camera: Pose, fov_rad: float, size: tuple[int, int], *, t_ns: int, seq: int
) -> Frame:
    """Render the frame, with ground truth, of a camera at `camera` on a robot at `robot`.

    Args:
        world: in its current state.
        robot: the pose of the robot's origin, in the world.
        camera: the pose of its camera, x along the optical axis.
        fov_rad: horizontal field of view.
        size: width and height of the image, px, both even.
        t_ns: the frame's capture time.
        seq: its sequence number.
    """
    width, height = size
    mask = world.render_mask(camera, fov_rad, height, width)
    _, small = world.render(camera, fov_rad, height // RGB_SHARE, width // RGB_SHARE)
    rgb = cv2.resize(small, (width, height), interpolation=cv2.INTER_LINEAR)
    return Frame(np.asarray(rgb, np.uint8), t_ns, seq, world.truth(mask, robot, camera, BODY_RADIUS_M))


class View(NamedTuple):
    """What a camera needs to know of one moment; poses are in the world frame."""

    t_ns: int
    robot: Pose
    camera: Pose
    going: bool
    """Whether the people walk; before that they stand still."""


class Studio:
    """The people of a world and the camera.

    Args:
        scenario: which world.
        fov_rad: the camera's horizontal field of view.
        size: width and height of the frames, px, both even.
    """

    def __init__(self, scenario: Scenario, fov_rad: float, size: tuple[int, int]) -> None:
        self._world = _world(scenario)
        self._fov_rad = fov_rad
        self._size = size
        self._last_ns: int | None = None
        self._seq = 0

    def take(self, view: View) -> Frame:
        """Let the people walk until the view's time, and render a frame."""
        if view.going:
            last_ns = view.t_ns if self._last_ns is None else self._last_ns
            self._world.step((view.t_ns - last_ns) / 1e9, view.robot)
            self._last_ns = view.t_ns
        self._seq += 1
        return take_frame(
            self._world, view.robot, view.camera, self._fov_rad, self._size, t_ns=view.t_ns, seq=self._seq
        )


class Rehearsal:
    """The robot in the world.

    Args:
        scenario: which world.
        body: reset here, at the world's start, facing the target.
        fov_rad: the camera's horizontal field of view.
        size: width and height of the frames, px, both even.
    """

    def __init__(
        self, scenario: Scenario, body: GroundBody, fov_rad: float, size: tuple[int, int] = (160, 160)
    ) -> None:
        self.scenario = scenario
        self.fov_rad = fov_rad
        self.size = size
        self._world = _world(scenario)
        self._body = body
        self._moving = threading.Lock()
        self._going = False
        body.reset(self._world.start, scenario.seed)

    def step(self, command: Twist, dt_s: float) -> None:
        """Step the body under `command` for `dt_s`; called from the protocol thread."""
        with self._moving:
            self._body.step(command, dt_s)
            self._body.place(self._world.grounded(self._body.pose, BODY_RADIUS_M))

    def go(self) -> None:
        """Start the people walking with the next frame."""
        self._going = True

    def view(self, now_ns: int) -> View:
        """Return the current view for the camera; called from the camera's thread."""
        with self._moving:
            return View(now_ns, self._body.pose, self._body.camera_pose, self._going)


def film(
    rehearsal: Rehearsal,
    clock: Clock,
    rate_hz: float,
    publish: Callable[[Frame], None],
    ended: threading.Event,
) -> threading.Thread:
    """Start a thread that has frames rendered at `rate_hz` and passes them to `publish` until `ended` is
    set."""

    def run() -> None:
        context = multiprocessing.get_context("spawn")
        here, there = context.Pipe()
        drawing = context.Process(
            target=_draw, args=(there, rehearsal.scenario, rehearsal.fov_rad, rehearsal.size), daemon=True
        )
        drawing.start()
        there.close()
        pacer = Pacer(clock, rate_hz)
        with here, contextlib.suppress(EOFError, ConnectionError):  # a failed camera shows nothing
            while not ended.is_set():
                here.send(rehearsal.view(pacer.wait().t_ns))
                while not here.poll(LOOK_S):
                    if ended.is_set():
                        break
                else:
                    publish(here.recv())
        drawing.terminate()
        drawing.join()

    thread = threading.Thread(target=run, name="camera", daemon=True)
    thread.start()
    return thread


def _draw(pipe: Connection, scenario: Scenario, fov_rad: float, size: tuple[int, int]) -> None:
    """Answer each view with its frame until the other end closes."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the requesting thread notices, and closes the pipe
    studio = Studio(scenario, fov_rad, size)
    with contextlib.suppress(EOFError, ConnectionError):
        while True:
            pipe.send(studio.take(pipe.recv()))


def _world(scenario: Scenario) -> World:
    return World(scenario.scene, seed=scenario.seed, target_speed_m_s=scenario.target_speed_m_s)
