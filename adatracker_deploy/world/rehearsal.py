"""A world with one ground robot in it, at the far end of that robot's wire.

Two threads meet here: the wire's, which drives the body, and the camera's, which lets the people walk and
looks. Obstacles and walls block the body, as the real ones would.
"""

from __future__ import annotations

import sys
import threading
from typing import TYPE_CHECKING

import cv2
import numpy as np

from adatracker_deploy.messages import Frame
from adatracker_deploy.runtime.pacer import Pacer
from adatracker_deploy.world.world import World

if TYPE_CHECKING:
    from collections.abc import Callable

    from adatracker_deploy.geometry import Pose
    from adatracker_deploy.platform import Scenario, Twist
    from adatracker_deploy.runtime.clock import Clock
    from adatracker_deploy.world.bodies import GroundBody

BODY_RADIUS_M = 0.3
"""How near an obstacle counts as a collision, and is kept off."""
SWITCH_S = 5e-4
"""Longest turn of a thread of the far end while another waits: Python's own 5 ms would keep the wire's thread
from its 20 ms period whenever a picture is drawn."""
RGB_SHARE = 2
"""Colours, which only people look at, are cast at half the resolution: a third of the time, so that
a rehearsal at five times real time keeps up."""


def take_frame(
    world: World, robot: Pose, camera: Pose, fov_rad: float, size: tuple[int, int], *, t_ns: int, seq: int
) -> Frame:
    """Return the frame, with its truth, that a camera at `camera` of a robot at `robot` takes.

    Args:
        world: with everybody where they are now.
        robot: the pose of the robot's origin, in the world.
        camera: the pose of its camera, x along the optical axis.
        fov_rad: horizontal field of view.
        size: width and height of the image, px, both even.
        t_ns: the frame's capture time.
        seq: its number.
    """
    width, height = size
    mask = world.render_mask(camera, fov_rad, height, width)
    _, small = world.render(camera, fov_rad, height // RGB_SHARE, width // RGB_SHARE)
    rgb = cv2.resize(small, (width, height), interpolation=cv2.INTER_LINEAR)
    return Frame(np.asarray(rgb, np.uint8), t_ns, seq, world.truth(mask, robot, camera, BODY_RADIUS_M))


class Rehearsal:
    """The robot's place in the world.

    Args:
        scenario: which world.
        body: reset here, at the world's start, facing the target.
        fov_rad: the camera's horizontal field of view.
        size: width and height of the frames, px, both even.
    """

    def __init__(
        self, scenario: Scenario, body: GroundBody, fov_rad: float, size: tuple[int, int] = (160, 160)
    ) -> None:
        self._world = World(scenario.scene, seed=scenario.seed, target_speed_m_s=scenario.target_speed_m_s)
        self._body = body
        self._fov_rad = fov_rad
        self._size = size
        self._moving = threading.Lock()
        self._going = False
        self._last_ns: int | None = None
        self._seq = 0
        body.reset(self._world.start, scenario.seed)

    def step(self, command: Twist, dt_s: float) -> None:
        """Let the body follow `command` for `dt_s`; from the wire's thread."""
        with self._moving:
            self._body.step(command, dt_s)
            self._body.place(self._world.grounded(self._body.pose, BODY_RADIUS_M))

    def go(self) -> None:
        """Let the people walk from the next frame on; they stand still until then."""
        self._going = True

    def look(self, now_ns: int) -> Frame:
        """Let the people walk until `now_ns` and take a frame; from the camera's thread."""
        with self._moving:
            robot, camera = self._body.pose, self._body.camera_pose
        if self._going:
            last_ns = now_ns if self._last_ns is None else self._last_ns
            self._world.step((now_ns - last_ns) / 1e9, robot)
            self._last_ns = now_ns
        self._seq += 1
        return take_frame(self._world, robot, camera, self._fov_rad, self._size, t_ns=now_ns, seq=self._seq)


def film(
    rehearsal: Rehearsal,
    clock: Clock,
    rate_hz: float,
    publish: Callable[[Frame], None],
    ended: threading.Event,
) -> threading.Thread:
    """Start a thread that takes frames at `rate_hz` and hands them to `publish` until `ended` is set."""

    sys.setswitchinterval(SWITCH_S)

    def run() -> None:
        pacer = Pacer(clock, rate_hz)
        while not ended.is_set():
            publish(rehearsal.look(pacer.wait().t_ns))

    thread = threading.Thread(target=run, name="camera", daemon=True)
    thread.start()
    return thread
