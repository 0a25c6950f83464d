"""The simulator's main loop: steps a base's firmware and body in a world on the shared clock."""

from __future__ import annotations

import math
import threading
import time
from collections import deque
from typing import TYPE_CHECKING

from adatracker_deploy.core.messages import ZERO
from adatracker_deploy.sim.process import FaultCommands
from adatracker_deploy.sim.rehearsal import Rehearsal
from adatracker_wheeled.protocol.codec import Codec
from adatracker_wheeled.sim.dynamics import WheeledBody
from adatracker_wheeled.sim.faults import FAULT_NAMES, FOREIGN_COMMANDS
from adatracker_wheeled.sim.firmware import Base

if TYPE_CHECKING:
    from collections.abc import Callable

    from adatracker_deploy.core.clock import Clock
    from adatracker_deploy.platform import Scenario
    from adatracker_wheeled.protocol.frames import CanFrame
    from adatracker_wheeled.protocol.roles import Roles
    from adatracker_wheeled.sim.settings import SitlSettings

STEP_S = 0.01
"""Time step of the body and of its controller."""
BATCH_S = 0.004
"""Machine time between two looks at what came in; a fast rehearsal makes several steps in it."""
LONGEST_LAG_S = 0.25
"""A process that was kept from running for longer skips the time instead of rushing through it."""
LINGER_S = 10.0
"""Machine time that the base has to come to rest after its parent process has ended."""
_MOST_UNREAD = 2000
"""Frames kept between two looks: a flood loses the oldest, and a bus carries no more than 80 in that time."""
_REST = 1e-3
"""m/s and rad/s."""


class Simulator:
    """One base with its power on, in one world.

    Args:
        roles: its messages.
        settings: of the simulated base.
        scenario: the world, and the seed of all that is random.
        clock: the run's.
        orders: fault commands, and where they are reported.

    Raises:
        UsageError: the roles do not fit the DBC, or there is no such scene.
    """

    def __init__(
        self,
        roles: Roles,
        settings: SitlSettings,
        scenario: Scenario,
        clock: Clock,
        orders: FaultCommands | None = None,
    ) -> None:
        self._orders = orders or FaultCommands()
        self._suffered: frozenset[str] = frozenset()
        """The orders' faults, as the base has heard of them."""
        self.base = Base(roles, settings, clock.speed)
        self._rival = _Rival(roles, clock)
        self.body = WheeledBody(settings, roles)
        fov_rad = math.radians(settings.camera.fov_deg)
        self.rehearsal = Rehearsal(scenario, self.body, fov_rad)
        self._clock = clock
        self._unread: deque[CanFrame] = deque(maxlen=_MOST_UNREAD)

    def hear(self, frame: CanFrame) -> None:
        """Take a frame from the bus; from any thread."""
        self._unread.append(frame)

    def serve(self, send: Callable[[CanFrame], object], ended: threading.Event) -> None:
        """Run until `ended` is set and the base rests, or `LINGER_S` after that.

        Args:
            send: puts one frame on the base's bus.
            ended: set when the parent process has ended.
        """
        clock, longest_ns = self._clock, round(LONGEST_LAG_S * self._clock.speed * 1e9)
        batch_ns = round(max(STEP_S, BATCH_S * clock.speed) * 1e9)
        power_on_ns = last_ns = deadline_ns = clock.now_ns()
        give_up_s = math.inf
        while True:
            deadline_ns = max(deadline_ns + batch_ns, clock.now_ns())
            clock.sleep_until(deadline_ns)
            now_ns = clock.now_ns()
            elapsed_s = min(now_ns - last_ns, longest_ns) / 1e9
            last_ns = now_ns
            for frame in self._advance((now_ns - power_on_ns) / 1e9, elapsed_s):
                send(frame)
            if ended.is_set():
                give_up_s = min(give_up_s, time.monotonic() + LINGER_S)
                if self._at_rest or time.monotonic() > give_up_s:
                    self._orders.witness.off()
                    return

    def _advance(self, now_s: float, elapsed_s: float) -> tuple[CanFrame, ...]:
        """Hear, move and tell."""
        self._suffer()
        while self._unread:
            asked = self.base.receive(self._unread.popleft(), now_s)
            if asked is not None:
                self._orders.witness.command(asked)
        theirs = self._rival.said() if FOREIGN_COMMANDS.name in self._orders.faults else ()
        for frame in theirs:
            self.base.receive(frame, now_s)
        steps = math.ceil(elapsed_s / STEP_S)
        for _ in range(steps):
            self.rehearsal.step(self.base.demand(now_s), elapsed_s / steps)
        self._orders.witness.speed(abs(self.body.velocity.vx))
        return theirs + self.base.transmit(self.body.measured, self.body.wheels_m, now_s)

    def _suffer(self) -> None:
        """Apply the faults that were commanded since."""
        ordered = self._orders.faults
        for name in ordered ^ self._suffered:
            if name in FAULT_NAMES:
                self.base.apply_faults(FAULT_NAMES[name], name in ordered)
        self._suffered = ordered

    @property
    def _at_rest(self) -> bool:
        motion = self.body.measured
        return abs(motion.vx) < _REST and abs(motion.yaw_rate) < _REST


class _Rival:
    """Another host on the bus, which commands the base to stand at the base's own rate."""

    def __init__(self, roles: Roles, clock: Clock) -> None:
        self._codec = Codec(roles)
        self._clock = clock
        self._period_ns = round(roles.timing.command_period_s * clock.speed * 1e9)
        self._count = self._due_ns = 0

    def said(self) -> tuple[CanFrame, ...]:
        """Return its frames if they are due."""
        if (now_ns := self._clock.now_ns()) < self._due_ns:
            return ()
        self._due_ns = now_ns + self._period_ns
        self._count += 1
        return self._codec.command(ZERO, self._count)[1]
