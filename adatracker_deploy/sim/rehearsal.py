"""A ground robot in its world: the protocol thread drives the body, which obstacles and walls block.

The camera and the people are `studio`'s, in another process: `Rehearsal.film` shows what it sees.
"""

from __future__ import annotations

import contextlib
import threading
from typing import TYPE_CHECKING

from adatracker_deploy.core.camera import is_unreal
from adatracker_deploy.core.geometry import Pose
from adatracker_deploy.sim.filming import DrawingProcess, film
from adatracker_deploy.sim.studio import BODY_RADIUS_M, View, world_of

if TYPE_CHECKING:
    from collections.abc import Callable

    from adatracker_deploy.core.clock import Clock
    from adatracker_deploy.core.messages import Shot, Twist
    from adatracker_deploy.platform import Scenario
    from adatracker_deploy.sim.bodies import GroundBody


class Rehearsal:
    """The robot in the world.

    Args:
        scenario: which world.
        body: reset here, at the world's start, facing the target.
        fov_rad: the camera's horizontal field of view.
    """

    def __init__(self, scenario: Scenario, body: GroundBody, fov_rad: float) -> None:
        self.scenario = scenario
        self.fov_rad = fov_rad
        # An engine serves one client, the process that draws: the body has a plain of its own then.
        self._world = None if is_unreal(scenario.scene) else world_of(scenario)
        self._body = body
        self._moving = threading.Lock()
        self._going = False
        body.reset(self._world.start if self._world else Pose(), scenario.seed)

    def step(self, command: Twist, dt_s: float) -> None:
        """Step the body under `command` for `dt_s`; called from the protocol thread."""
        with self._moving:
            self._body.step(command, dt_s)
            if self._world is not None:
                self._body.place(self._world.grounded(self._body.pose, BODY_RADIUS_M))

    def go(self) -> None:
        """Start the people walking with the next frame."""
        self._going = True

    def view(self, now_ns: int) -> View:
        """Return the current view for the camera; called from the camera's thread."""
        with self._moving:
            return View(now_ns, self._body.pose, self._body.camera_pose, self._going)

    def film(
        self, clock: Clock, rate_hz: float, publish: Callable[[Shot], None], ended: threading.Event
    ) -> threading.Thread:
        """Start a thread that passes the camera's pictures to `publish` until `ended` is set.

        A camera that fails shows nothing from then on.
        """

        def run() -> None:
            drawing = DrawingProcess(self.scenario, self.fov_rad, own_frame=self._world is None)
            with contextlib.suppress(EOFError, ConnectionError):
                film(drawing, self.view, clock, rate_hz, publish, ended=ended)

        thread = threading.Thread(target=run, name="camera", daemon=True)
        thread.start()
        return thread
