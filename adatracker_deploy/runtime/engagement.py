"""The trial's requests to its link, with waiting: engage, stand still, disengage."""

from __future__ import annotations

import math
import time
from typing import TYPE_CHECKING

from adatracker_deploy.core.errors import PlatformError
from adatracker_deploy.core.messages import ZERO
from adatracker_deploy.runtime.gate import Setpoint
from adatracker_deploy.runtime.link import Phase
from adatracker_deploy.runtime.pulse import LINK_LOST

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from adatracker_deploy.core.clock import MonotonicClock
    from adatracker_deploy.runtime.link import LinkStatus
    from adatracker_deploy.runtime.link_process import LinkProcess

ENGAGE_TIMEOUT_S = 60.0
DISENGAGE_TIMEOUT_S = 60.0
STANDSTILL_TIMEOUT_S = 5.0
STANDSTILL_M_S = 0.25
"""Speed below which a robot counts as standing: just above the velocity noise of a small drone's
estimator."""
POLL_S = 0.02


class Engagement:
    """A robot's life cycle within a trial; every time-out is in the run's clock.

    Args:
        link: connected.
        clock: the run's.
        tell: receives progress messages.
    """

    def __init__(self, link: LinkProcess, clock: MonotonicClock, tell: Callable[[str], None]) -> None:
        self._link = link
        self._clock = clock
        self._tell = tell

    def begin(self, meanwhile: Callable[[], None] = lambda: None) -> None:
        """Engage, and wait until the robot follows commands.

        Args:
            meanwhile: called again and again; what it raises ends the wait.

        Raises:
            PlatformError: it stopped while engaging, or was not engaged within `ENGAGE_TIMEOUT_S`.
        """
        self._link.engage()
        airborne = False
        for status in self.statuses(ENGAGE_TIMEOUT_S):
            meanwhile()
            self.stand_by()
            if not airborne and not status.state.landed:
                airborne = True
                self._tell("airborne")
            if status.phase is Phase.ACTIVE:
                self._tell("engaged")
                return
            if status.phase is not Phase.ENGAGING and status.stopped:
                raise PlatformError(status.stopped)
        raise PlatformError(f"the robot was not engaged within {ENGAGE_TIMEOUT_S:g} s")

    def stand_by(self) -> None:
        """Ask for standing still; to be repeated, since the link gives up a robot whose trial is silent."""
        self._link.send(Setpoint(ZERO, self._clock.now_ns()))

    def stand_still(self, reason: str) -> float | None:
        """Hold; return the time until the robot stood still, s of the run's clock, or None if it was not
        moving.

        Raises:
            PlatformError: it was still moving after `STANDSTILL_TIMEOUT_S`.
        """
        self._link.hold(reason)
        began_ns = self._clock.now_ns()
        for status in self.statuses(STANDSTILL_TIMEOUT_S):
            if status.phase in (Phase.DISENGAGING, Phase.DONE, Phase.IDLE):
                return None
            velocity = status.state.velocity
            if status.phase is Phase.HOLDING and velocity is not None:
                speed = math.hypot(velocity.vx, velocity.vy, velocity.vz)
                if speed < STANDSTILL_M_S:
                    return (self._clock.now_ns() - began_ns) / 1e9
        raise PlatformError(f"the robot did not stand still within {STANDSTILL_TIMEOUT_S:g} s of the stop")

    def end(self, reason: str) -> None:
        """Disengage, and wait until done.

        Raises:
            PlatformError: it was not disengaged within `DISENGAGE_TIMEOUT_S`.
        """
        self._link.disengage(reason)
        for status in self.statuses(DISENGAGE_TIMEOUT_S):
            if status.phase is Phase.DONE:
                return
        raise PlatformError(f"the robot did not disengage within {DISENGAGE_TIMEOUT_S:g} s")

    def statuses(self, timeout_s: float) -> Iterator[LinkStatus]:
        """Yield the link's newest status repeatedly for `timeout_s`.

        Raises:
            PlatformError: the link process died, or does not respond.
        """
        began_ns = self._clock.now_ns()
        while (self._clock.now_ns() - began_ns) / 1e9 < timeout_s:
            if not self._link.alive():
                raise PlatformError(LINK_LOST)
            status = self._link.status()
            if status is not None:
                yield status
            time.sleep(POLL_S / self._clock.speed)
