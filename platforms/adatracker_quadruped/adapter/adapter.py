"""The quadruped's adapter: sends body velocities to a robot that speaks ROS 2 over Zenoh."""

from __future__ import annotations

import math
import threading
import time
from dataclasses import replace
from typing import TYPE_CHECKING

from adatracker_deploy.config.camera_topic import with_camera
from adatracker_deploy.core.camera import ROBOT
from adatracker_deploy.core.errors import PlatformError
from adatracker_deploy.core.log_throttle import worth_logging
from adatracker_deploy.core.messages import LONGEST_REASON, ZERO, PlatformState, Twist
from adatracker_deploy.core.stamps import fresh_or_none
from adatracker_deploy.platform import Check, Platform
from adatracker_deploy.runtime.suspend import SuspendWatch
from adatracker_quadruped.adapter.preflight import judge
from adatracker_quadruped.adapter.probe import probe, until
from adatracker_quadruped.adapter.transport import Wire
from adatracker_quadruped.protocol.connection import Connection
from adatracker_quadruped.protocol.keys import Keys

if TYPE_CHECKING:
    from adatracker_deploy.config.profile import Profile
    from adatracker_deploy.core.camera import Camera
    from adatracker_deploy.core.clock import Clock
    from adatracker_quadruped.adapter.subscriber import Reading

_ZEROS = 3
_ZERO_PERIOD_S = 0.02
_REST_TIMEOUT_S = 3.0
_REST_M_S, _REST_RAD_S = 0.1, 0.2
"""Measured motion below both is rest: the trunk of a robot that stands still sways."""


class QuadrupedAdapter(Platform):
    """A walking robot behind Zenoh.

    Such a robot has nothing to enable: engaging checks that it listens and is heard. A stop latches here, in
    addition to the robot's own time-out: a connection that comes back moves nothing.
    """

    name = "quadruped"
    axes = frozenset({"vx", "vy", "yaw_rate"})
    Connection = Connection
    default_profile = "go2"

    @classmethod
    def identity(cls, profile: Profile) -> str:
        """Name the quadruped's connection: the same for every profile that reaches it from this machine."""
        return str(profile.connection.robot)

    def __init__(self, profile: Profile, clock: Clock) -> None:
        super().__init__(profile, clock)
        self._connection: Connection = profile.connection
        self._opening = threading.Lock()
        """Held while the wire is opened, tried or closed."""
        self._steering = threading.Lock()
        """Held for one command at a time, so that none is sent after a stop."""
        self._wire: Wire | None = None
        self._engaged = False
        self._in_charge = False
        """Engaged since the last disengage; only then may this side stop the robot."""
        self._stopped = ""
        self._stops = 0
        """Number of stop requests, whether or not there was anything to stop."""
        self._suspends = SuspendWatch(clock)
        self._sent_ns = 0
        """Time of the newest command; 0 since the last engage."""
        self._told = 0
        """Number of malformed messages at the last notice."""

    def connect(self) -> None:
        """Dial the robot and wait for its odometry; moves nothing.

        Raises:
            PlatformError: nobody answers, or no odometry comes, within `connect_timeout_s` in all.
            UsageError: a certificate's file is not there.
        """
        with self._opening:
            if self._wire is not None:
                return
            deadline_s = time.monotonic() + self._connection.connect_timeout_s
            wire = Wire(self._connection, self.clock)
            if not until(lambda: wire.watch.odometry.newest is not None, deadline_s):
                dropped = wire.watch.odometry.dropped
                wire.close()
                raise PlatformError(
                    f"{self._connection.endpoint} answers, but no odometry came on "
                    f"{Keys(self._connection).odometry} within {self._connection.connect_timeout_s:g} s"
                    + (f" ({dropped} malformed messages did)" if dropped else "")
                    + ": start the robot's nodes, or correct connection.odometry_topic, namespace or dialect"
                )
            self._wire = wire

    def preflight(self) -> tuple[Check, ...]:
        """Listen for half a second, at most two, and check what was heard."""
        carries_camera = self.profile.camera.uri.startswith(ROBOT)
        camera_key = Keys(with_camera(self.profile)).camera if carries_camera else ""
        with self._opening:
            return judge(probe(self._connected(), camera_key), self._connection)

    def engage(self) -> None:
        """Accept commands from now on.

        Raises:
            PlatformError: another host has the robot, nobody listens to commands, the robot is not heard, or
                somebody called `hold`, `disengage` or `close` meanwhile.
        """
        stops = self._stops
        with self._opening:
            wire = self._connected()
            if not wire.lease.take(lambda: self._stops != stops) and self._stops == stops:
                raise PlatformError(f"another host holds {self._connection.host_token}: end it first")
        with self._steering:
            if self._engaged:
                return
            if self._stops != stops:
                raise PlatformError(
                    f"engaging was stopped: {self._stopped or 'disengage or close was asked for'}"
                )
            self._suspends.begin()
            if why := self._trouble(wire):
                raise PlatformError(why)
            self._engaged = self._in_charge = True
            self._stopped, self._sent_ns = "", 0

    def send(self, command: Twist, now_ns: int) -> Twist:
        """Send one velocity, without its vertical part; return what was sent.

        Raises:
            PlatformError: the command is not finite, or the robot is not engaged. Also if it is gone, or has
                stopped by itself for want of commands: then a zero goes out and the stop latches.
        """
        if not command.is_finite():
            raise PlatformError(f"refused to send {command}: not finite")
        with self._steering:
            wire = self._connected()
            if not self._engaged:
                raise PlatformError(f"not engaged: {self._stopped or 'engage first'}")
            if why := self._pause(now_ns) or self._trouble(wire):
                self._stopped, self._engaged = why, False  # in this order, for who reads without the lock
                self._in_charge = not wire.lease.lost()  # another owner's robot gets one zero and no more
                wire.commander.walk(ZERO, time.time_ns())
                wire.lease.release()  # who was cut off for long is not the owner that others have seen
                raise PlatformError(why)
            sent = replace(command, vz=0.0)
            age_ns = (self.clock.now_ns() - now_ns) / self.clock.speed
            wire.commander.walk(sent, time.time_ns() - round(age_ns))
            self._sent_ns = now_ns
            return sent

    def state(self) -> PlatformState:
        """Return the newest odometry and battery state; the pose is in the robot's odometry frame."""
        wire, engaged, stopped = self._wire, self._engaged, self._stopped[:LONGEST_REASON]
        reading = wire.watch.odometry.newest if wire is not None else None
        if wire is None or reading is None:
            return PlatformState(t_ns=0, stopped=stopped)
        battery = wire.watch.battery.newest if wire.watch.battery is not None else None
        return PlatformState(
            t_ns=reading.t_ns,
            mode="DRIVE" if engaged else "READY",
            engaged=engaged,
            pose=reading.value.pose,
            velocity=reading.value.velocity,
            battery=self._charge(battery),
            stopped=stopped,
        )

    def _charge(self, reading: Reading[float | None] | None) -> float | None:
        if reading is None:
            return None
        return fresh_or_none(reading.value, reading.t_ns, self.clock, self._connection.battery_timeout_s)

    def notices(self) -> tuple[str, ...]:
        """Return notices about malformed messages from the robot."""
        wire = self._wire
        count = wire.watch.dropped if wire is not None else 0
        told, self._told = self._told, count
        return (f"Zenoh: {count} malformed messages were dropped",) if worth_logging(told, count) else ()

    def hold(self, reason: str) -> None:
        """Send zero three times; no command follows until an explicit `engage`."""
        self._withdraw(reason)
        wire = self._wire
        if wire is not None and self._in_charge:
            self._send_zeros(wire)

    def disengage(self) -> None:
        """Do as `hold`, tell the robot to stand, and return when it does.

        Raises:
            PlatformError: it was not seen to stand within 3 s.
        """
        asked_ns = self.clock.now_ns()
        wire = self._give_back()
        if wire is None:
            return

        def stands() -> bool:
            reading = wire.watch.odometry.newest
            seen = reading is not None and reading.t_ns > asked_ns and _at_rest(reading.value.velocity)
            return seen or self._engaged or self._wire is not wire

        if not until(stands, time.monotonic() + _REST_TIMEOUT_S):
            raise PlatformError(
                f"the robot was not seen to stand {_REST_TIMEOUT_S:g} s after the stop: "
                "stop it with its own remote control"
            )

    def close(self) -> None:
        """Make the robot stand, drop the token and close the session; does not wait."""
        self._give_back()
        with self._opening:
            with self._steering:
                wire, self._wire = self._wire, None
                self._engaged = self._in_charge = False
            if wire is not None:
                wire.close()

    @classmethod
    def camera(cls, profile: Profile, clock: Clock) -> Camera:
        """Return the robot's own camera: CompressedImage on the topic after ``robot://``."""
        from adatracker_quadruped.adapter.camera import ZenohCamera

        return ZenohCamera(profile, clock)

    def _connected(self) -> Wire:
        wire = self._wire
        if wire is None:
            raise PlatformError("the robot is not connected: connect first")
        return wire

    def _trouble(self, wire: Wire) -> str:
        if why := self._suspends.trouble() or wire.watch.trouble() or wire.lease.lost():
            return why
        return "" if wire.commander.matched else f"nobody subscribes to {wire.commander.key}"

    def _pause(self, now_ns: int) -> str:
        """Latch a stop after the robot has timed out, so that the next command does not restart it."""
        paused_s = (now_ns - self._sent_ns) / 1e9 / self.clock.speed if self._sent_ns else 0.0
        over = paused_s > self._connection.command_timeout_s
        return f"no command for {paused_s:.2f} s: the robot has stopped by itself" if over else ""

    def _withdraw(self, reason: str) -> None:
        self._stops += 1
        with self._steering:
            self._stopped = self._stopped or reason
            self._engaged = False

    def _give_back(self) -> Wire | None:
        """Make the robot stand and give up control; return its connection, None if it was not in our
        charge."""
        self._withdraw("")
        wire = self._wire
        if wire is None or not self._in_charge:
            return None
        self._send_zeros(wire)
        with self._steering:
            if self._may_stop(wire):
                wire.commander.stand(time.time_ns())
                self._in_charge = False
        return wire

    def _may_stop(self, wire: Wire) -> bool:
        """Return whether the robot is still this side's, and nobody engaged again or closed meanwhile."""
        return self._in_charge and not self._engaged and self._wire is wire

    def _send_zeros(self, wire: Wire) -> None:
        for _ in range(_ZEROS):
            with self._steering:
                if not self._may_stop(wire):
                    return
                wire.commander.walk(ZERO, time.time_ns())
            time.sleep(_ZERO_PERIOD_S)


def _at_rest(velocity: Twist) -> bool:
    return math.hypot(velocity.vx, velocity.vy) < _REST_M_S and abs(velocity.yaw_rate) < _REST_RAD_S
