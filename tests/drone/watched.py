"""A simulated drone in a thread of the test's own: what it is told is written down, and it has a pilot."""

from __future__ import annotations

import collections
import contextlib
import dataclasses
import threading
import time
from typing import NamedTuple

from test_platform_sitl import rehearsal_profile

from adatracker_deploy.core.clock import MonotonicClock
from adatracker_drone.platform import DronePlatform
from adatracker_drone.protocol.px4 import Mode
from adatracker_drone.sim.autopilot import velocity_of
from adatracker_drone.sim.simulator import Simulator

ARM_DISARM, SET_MODE, TAKE_OFF, LAND = 400, 176, 22, 21
MODES = {ARM_DISARM: "", SET_MODE: "", TAKE_OFF: "TAKEOFF", LAND: "LAND"}


class Told(NamedTuple):
    """Something that came to the drone."""

    at_s: float
    """Monotonic."""
    order: str
    """ARM, DISARM, the mode that is asked for, MOVE or ZERO."""


class Watched(Simulator):
    """Runs until it is closed and stands."""

    def __init__(self, profile, clock, *, seed=1):
        port = int(profile.connection.url.rpartition(":")[2])
        super().__init__(profile.sitl, seed, clock.speed, [("127.0.0.1", port)])
        self.told: list[Told] = []
        self.autopilot = self._autopilot
        self._pilot = collections.deque()
        self._hear, self.autopilot.receive = self.autopilot.receive, self._write_down
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self.serve, args=(clock, self._ended))
        self._thread.start()

    @property
    def motion(self):
        return self._body.motion

    @property
    def mode(self):
        return self.autopilot.commander.mode

    def pilot(self, mode: Mode) -> float:
        """Switch modes as a remote control does, and return when that was."""
        done = threading.Event()
        self._pilot.append((mode, done))
        assert done.wait(5.0)
        return time.monotonic()

    def since(self, at_s, *but):
        """Return what it was told after a time, but some kinds."""
        return [told for told in self.told if told.at_s > at_s and told.order not in but]

    def close(self):
        self._ended.set()
        self._thread.join()

    def _let_the_pilot_fly(self, piloted):
        while self._pilot:
            mode, done = self._pilot.popleft()
            self.autopilot.commander.request(mode, self._ticks * 0.004)
            done.set()

    def _write_down(self, message):
        velocity = velocity_of(message)
        if velocity is not None:
            moves = max(map(abs, (velocity.vx, velocity.vy, velocity.yaw_rate))) > 0
            self.told.append(Told(time.monotonic(), "MOVE" if moves else "ZERO"))
        elif message.get_type() == "COMMAND_LONG" and message.command in MODES:
            order = MODES[message.command]
            if message.command == ARM_DISARM:
                order = "ARM" if message.param1 else "DISARM"
            elif message.command == SET_MODE:
                order = Mode.find(int(message.param2), int(message.param3)).name
            self.told.append(Told(time.monotonic(), order))
        self._hear(message)


@contextlib.contextmanager
def watched(*, speed=1.0, connection=None, limits=None, **sitl):
    """A drone, and an adapter that is ready to engage; at the end the drone is down."""
    profile, clock = rehearsal_profile(**sitl), MonotonicClock(speed)
    profile = dataclasses.replace(
        profile,
        connection=dataclasses.replace(profile.connection, **(connection or {})),
        limits=dataclasses.replace(profile.limits, **(limits or {})),
    )
    with contextlib.closing(Watched(profile, clock)) as drone, DronePlatform(profile, clock) as platform:
        platform.connect()
        assert not [check for check in platform.preflight() if check.blocking and not check.ok]
        yield drone, platform
        drone.pilot(Mode.LAND)
        end_s = time.monotonic() + 30.0
        while not drone.autopilot.at_rest and time.monotonic() < end_s:
            time.sleep(0.05)


def until(condition, within_s=20.0):
    pause, end_s = threading.Event(), time.monotonic() + within_s
    while not condition():
        assert time.monotonic() < end_s, "waited in vain"
        pause.wait(0.002)
