"""A virtual camera: draws a world from the robot's reported pose.

The robot may be simulated or real: a real drone in an empty field, or any other autopilot or simulator with
the same protocol, can follow a virtual person this way.
"""

from __future__ import annotations

import math
import threading
from typing import TYPE_CHECKING

from adatracker_deploy.core.errors import PlatformError, line_of
from adatracker_deploy.perception.jpeg import developed
from adatracker_deploy.sim.filming import DrawingProcess, film
from adatracker_deploy.sim.studio import View

if TYPE_CHECKING:
    from collections.abc import Callable

    from adatracker_deploy.core.clock import Clock
    from adatracker_deploy.core.geometry import Pose
    from adatracker_deploy.core.messages import Frame, Shot
    from adatracker_deploy.platform import CameraMount, Scenario


class WorldCamera:
    """Has pictures of a world drawn, at a steady rate, by a process of their own.

    It begins with the first `read` for which the robot has reported a pose, and lays the robot at the world's
    start then, facing the target; the people stand still until `go`.

    Args:
        scenario: which world.
        mount: where the camera sits on the body.
        pose: returns the robot's newest reported pose, or None; from another thread.
        clock: the run's.
        rate_hz: pictures a second of the run's.
    """

    def __init__(
        self,
        scenario: Scenario,
        mount: CameraMount,
        pose: Callable[[], Pose | None],
        clock: Clock,
        rate_hz: float,
    ) -> None:
        self._scenario, self._mount = scenario, mount
        self._pose, self._clock, self._rate_hz = pose, clock, rate_hz
        self._watched = self._going = False
        self._newest: Frame | None = None
        self._error: PlatformError | None = None
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run, name="world camera", daemon=True)

    def open(self) -> None:
        """Start what draws, which takes a while."""
        self._thread.start()

    def close(self) -> None:
        """End drawing; may be called twice, and before `open`."""
        self._ended.set()
        if self._thread.is_alive():
            self._thread.join()

    def go(self) -> None:
        """Let the people walk from the next picture on."""
        self._going = True

    def read(self, now_ns: int) -> Frame | None:  # noqa: ARG002 -- a camera's
        """Return the newest picture; None while there is none.

        Raises:
            PlatformError: there will be no more.
        """
        self._watched = True
        if self._error is not None:
            raise self._error
        return self._newest

    def _run(self) -> None:
        try:
            fov_rad = math.radians(self._mount.fov_deg)
            drawing = DrawingProcess(self._scenario, fov_rad, own_frame=True)
            film(drawing, self._view, self._clock, self._rate_hz, self._keep, ended=self._ended)
        except Exception as error:  # raised by the next read
            self._error = PlatformError(f"the virtual world cannot be drawn: {line_of(error)}")

    def _view(self, now_ns: int) -> View | None:
        robot = self._pose() if self._watched else None
        return None if robot is None else View(now_ns, robot, self._mount.pose(robot), self._going)

    def _keep(self, shot: Shot) -> None:
        self._newest = developed(shot)
