"""The simulator's main loop: a base in a world, and its node."""

from __future__ import annotations

import math
import threading
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

from adatracker_deploy.config.schema import Range
from adatracker_deploy.core.clock import MonotonicClock
from adatracker_deploy.core.faults import (
    BATTERY_LOW,
    CAMERA_FREEZE,
    CAMERA_GONE,
    LINK_DROP,
    ROBOT_SILENT,
    TAKEOVER,
)
from adatracker_deploy.core.messages import ZERO
from adatracker_deploy.runtime.pacer import Pacer
from adatracker_deploy.sim.process import FaultCommands
from adatracker_deploy.sim.rehearsal import Rehearsal
from adatracker_deploy.sim.render.lens import Lens
from adatracker_ros2.protocol.connection import Connection
from adatracker_ros2.protocol.messages import Odometry, in_odom
from adatracker_ros2.sim.dynamics import Ros2Body
from adatracker_ros2.sim.faults import FROZEN_ODOMETRY
from adatracker_ros2.sim.robot_node import STALE_S, RobotNode, Teleop
from adatracker_ros2.sim.settings import SitlSettings

if TYPE_CHECKING:
    from adatracker_deploy.core.clock import Clock
    from adatracker_deploy.core.messages import Shot
    from adatracker_deploy.platform import Scenario

LOOK_HZ = 100.0
"""Polling rate for commands in machine time; also bounds the delay of a stop."""
LONGEST_LAG_S = 0.25
"""A process that was kept from running for longer skips the time instead of rushing through it."""
DEAF_S = 0.2
"""After a gap in which commands may have piled up, machine time for which all of them are dropped."""
LINGER_S = 5.0
"""Machine time that the robot has to stand after its parent process has ended."""
_BATTERY_HZ = 1.0
_LOW = 0.05


@dataclass(frozen=True, slots=True, kw_only=True)
class Robot:
    """The simulated robot's settings."""

    connection: Connection
    """Its names and types; with a camera topic."""
    sitl: SitlSettings
    camera_hz: Annotated[float, Range(1, 240)]


class Simulator:
    """One robot, standing, that anybody on this machine who knows its topics can drive.

    Args:
        robot: what it is.
        scenario: the world that it stands in.
        clock: the run's.
        orders: fault commands, and where they are reported.

    Raises:
        PlatformError: ROS 2 does not start.
        UsageError: no such scene.
    """

    def __init__(
        self, robot: Robot, scenario: Scenario, clock: Clock, orders: FaultCommands | None = None
    ) -> None:
        self._robot, self._clock = robot, clock
        self._orders = orders or FaultCommands()
        self._body = Ros2Body(robot.sitl)
        fov_rad = math.radians(robot.sitl.camera.fov_deg)
        self._rehearsal = Rehearsal(scenario, self._body, fov_rad)
        self._lens = Lens().camera_info(fov_rad, *scenario.picture_size)
        self._node: RobotNode | None = self._join()
        """None while it is cut off."""
        self._teleop: Teleop | None = None
        self._using = threading.Lock()
        """Held while publishing or cutting the link: a node must not be destroyed meanwhile."""
        self._command, self._obeyed_s = ZERO, -math.inf
        self._odometry, self._battery = _Due(robot.sitl.odometry_hz), _Due(_BATTERY_HZ)
        self._told: Odometry | None = None
        self._shown: tuple[Shot, int] | None = None
        """The newest image with its stamp."""

    def serve(self, lifeline_ended: threading.Event) -> None:
        """Run until the parent process has ended and the robot stands, or `LINGER_S` after that end."""
        filming_ended = threading.Event()
        filming = self._rehearsal.film(self._clock, self._robot.camera_hz, self._show, filming_ended)
        try:
            self._drive(lifeline_ended)
        finally:
            filming_ended.set()
            filming.join()
            self._mend(cut=True, taken=False)

    def _drive(self, lifeline_ended: threading.Event) -> None:
        give_up_s, deaf_until_s = math.inf, 0.0
        looked_s, last_ns = time.monotonic(), self._clock.now_ns()
        pacer = Pacer(MonotonicClock(), LOOK_HZ)
        while True:
            pacer.wait()
            now_s, now_ns = time.monotonic(), self._clock.now_ns()
            if now_s - looked_s > STALE_S:
                deaf_until_s = now_s + DEAF_S
            looked_s, faults = now_s, self._orders.faults
            self._mend(cut=LINK_DROP.name in faults, taken=TAKEOVER.name in faults)
            self._listen(now_s, deaf=now_s < deaf_until_s)
            if lifeline_ended.is_set():
                self._command = ZERO
                give_up_s = min(give_up_s, now_s + LINGER_S)
                if self._body.velocity == ZERO or now_s > give_up_s:
                    self._orders.witness.off()
                    return
            passed_s = min((now_ns - last_ns) / 1e9, LONGEST_LAG_S * self._clock.speed)
            last_ns = now_ns
            self._rehearsal.step(self._command, passed_s)
            self._orders.witness.speed(math.hypot(self._body.velocity.vx, self._body.velocity.vy))
            self._tell(faults, now_ns, time.time_ns())

    def _join(self) -> RobotNode:
        return RobotNode(self._robot.connection, self._robot.sitl, self._lens, self._rehearsal.go)

    def _mend(self, *, cut: bool, taken: bool) -> None:
        """Take the robot's node out of the graph or back into it; the same for somebody else's."""
        if cut != (self._node is None):  # else nobody waits here for an image that is being published
            with self._using:
                if self._node is not None:
                    self._node.close()
                self._node = None if cut else self._join()
        if taken and self._teleop is None:
            self._teleop = Teleop(self._robot.connection)
        elif not taken and self._teleop is not None:
            self._teleop.close()
            self._teleop = None

    def _listen(self, now_s: float, *, deaf: bool) -> None:
        """Obey the newest command; stop if there is none for the robot's own time-out."""
        command = self._node.command() if self._node is not None else None
        if command is not None and not deaf:
            self._orders.witness.command(command)
            self._command, self._obeyed_s = command, now_s
        if deaf or now_s - self._obeyed_s > self._robot.connection.command_timeout_s:
            self._command = ZERO

    def _tell(self, faults: frozenset[str], now_ns: int, unix_ns: int) -> None:
        """Publish each topic whose period has passed."""
        node = self._node
        if node is None or ROBOT_SILENT.name in faults:
            return
        if self._odometry.due(now_ns):
            if FROZEN_ODOMETRY.name not in faults or self._told is None:
                told = Odometry(self._body.odometry, self._body.measured, unix_ns)
                self._told = in_odom(told) if self._robot.connection.odometry_velocity == "odom" else told
            node.tell_odometry(self._told)
        if self._battery.due(now_ns):
            node.tell_battery(_LOW if BATTERY_LOW.name in faults else self._robot.sitl.battery)

    def _show(self, shot: Shot) -> None:
        """Publish an image; called from the camera's thread."""
        faults = self._orders.faults
        if ROBOT_SILENT.name in faults or CAMERA_GONE.name in faults:
            return
        if CAMERA_FREEZE.name not in faults or self._shown is None:
            self._shown = (shot, time.time_ns())
        with self._using:
            if self._node is not None:
                self._node.show(*self._shown)


class _Due:
    """A period by the run's clock; a missed slot is skipped."""

    def __init__(self, rate_hz: float) -> None:
        self._period_ns = round(1e9 / rate_hz)
        self._next_ns = 0

    def due(self, now_ns: int) -> bool:
        if now_ns < self._next_ns:
            return False
        self._next_ns = max(self._next_ns + self._period_ns, now_ns + self._period_ns // 2)
        return True
