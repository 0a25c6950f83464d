"""The stop of a ground robot that obeys velocities: said once for whatever carries them.

A robot that takes a Twist and gives odometry has nothing to enable. So its adapter alone decides whether it
is driven, and latches a stop, in addition to the robot's own time-out: nothing that comes back, a network, a
robot or this program after a pause, sets the robot going again. What carries the messages is a `Wire`.
"""

from __future__ import annotations

import abc
import contextlib
import math
import threading
import time
from dataclasses import replace
from typing import TYPE_CHECKING, ClassVar, Generic, Protocol, TypeVar

from adatracker_deploy.core.clock import until
from adatracker_deploy.core.errors import PlatformError
from adatracker_deploy.core.log_throttle import worth_logging
from adatracker_deploy.core.messages import LONGEST_REASON, ZERO, PlatformState, Twist
from adatracker_deploy.core.stamps import fresh_or_none
from adatracker_deploy.platform import Platform
from adatracker_deploy.runtime.suspend import SuspendWatch

if TYPE_CHECKING:
    from collections.abc import Callable

    from adatracker_deploy.config.profile import Profile
    from adatracker_deploy.core.clock import Clock
    from adatracker_deploy.core.geometry import Pose
    from adatracker_deploy.core.stamps import Reading

_ZEROS = 3
_ZERO_PERIOD_S = 0.02
_REST_TIMEOUT_S = 3.0
_REST_M_S, _REST_RAD_S = 0.1, 0.2
"""Measured motion below both is rest: the trunk of a robot that stands still sways."""


class Odometry(Protocol):
    """What every message of odometry tells."""

    @property
    def pose(self) -> Pose:
        """In the robot's odometry frame."""

    @property
    def velocity(self) -> Twist:
        """In the body's frame."""


class Wire(Protocol):
    """An open connection to a robot; only `claim` and `close` may wait."""

    @property
    def odometry(self) -> Reading[Odometry] | None:
        """The newest odometry, None before the first."""

    @property
    def battery(self) -> Reading[float | None] | None:
        """The newest charge, 0 to 1; None before the first, and from a robot that tells none."""

    @property
    def dropped(self) -> int:
        """Number of malformed messages."""

    def claim(self, given_up: Callable[[], bool]) -> str:
        """Become the robot's owner; return why not, empty if it is.

        Args:
            given_up: looked at meanwhile; nobody wants to own the robot any more when it says so.
        """

    def rival(self) -> str:
        """Describe somebody else who commands the robot; empty if nobody does."""

    def trouble(self) -> str:
        """Describe why the robot must not be driven any further; empty while it may."""

    def owned(self) -> bool:
        """Return whether the robot is still this side's to stop."""

    def release(self) -> None:
        """Own the robot no longer, after a failure: `claim` asks anew."""

    def drive(self, command: Twist, stamp_ns: int) -> None:
        """Send one velocity, made at `stamp_ns` since 1970."""

    def stand(self, stamp_ns: int) -> None:
        """Announce that no command will follow."""

    def close(self) -> None:
        """Close it; may be called twice."""


W = TypeVar("W", bound=Wire)


class _Connection(Protocol):
    @property
    def command_timeout_s(self) -> float: ...
    @property
    def battery_timeout_s(self) -> float: ...


class VelocityAdapter(Platform, Generic[W]):
    """Drives a robot over a `Wire`, which `_open` opens; see `Platform`."""

    axes = frozenset({"vx", "vy", "yaw_rate"})
    carrier: ClassVar[str]
    """Name of what carries the messages, for notices."""

    def __init__(self, profile: Profile, clock: Clock) -> None:
        super().__init__(profile, clock)
        self._timeouts: _Connection = profile.connection
        self._opening = threading.Lock()
        """Held while the wire is opened, tried or closed."""
        self._steering = threading.Lock()
        """Held for one command at a time, so that none is sent after a stop."""
        self._wire: W | None = None
        self._engaged = False
        self._in_charge = False
        """Engaged since the last disengage; only then may this side stop the robot."""
        self._stopped = ""
        self._taken = False
        """Somebody else has begun to command the robot since the last engage."""
        self._stops = 0
        """Number of stop requests, whether or not there was anything to stop."""
        self._suspends = SuspendWatch(clock)
        self._sent_ns = 0
        """Time of the newest command; 0 since the last engage."""
        self._told = 0
        """Number of malformed messages at the last notice."""

    @abc.abstractmethod
    def _open(self) -> W:
        """Open the wire and wait for the robot; move nothing, and leave nothing open on an error.

        Raises:
            PlatformError: the robot does not answer within `connect_timeout_s`.
            UsageError: the profile's connection is wrong.
        """

    def connect(self) -> None:
        """Reach the robot and wait for its odometry; moves nothing.

        Raises:
            PlatformError, UsageError: as `_open`.
        """
        with self._opening:
            if self._wire is None:
                self._wire = self._open()

    def engage(self) -> None:
        """Accept commands from now on.

        Raises:
            PlatformError: somebody else has the robot or commands it, nobody listens to commands, the robot
                is not heard, or somebody called `hold`, `disengage` or `close` meanwhile.
        """
        stops = self._stops

        def given_up() -> bool:
            return self._stops != stops

        with self._opening:
            wire = self._connected()
            if (why := wire.claim(given_up)) and not given_up():
                raise PlatformError(why)
        with self._steering:
            if self._engaged:
                return
            if given_up():
                raise PlatformError(
                    f"engaging was stopped: {self._stopped or 'disengage or close was asked for'}"
                )
            self._suspends.begin()
            if why := wire.rival() or self._trouble(wire):
                raise PlatformError(why)
            self._engaged = self._in_charge = True
            self._stopped, self._taken, self._sent_ns = "", False, 0

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
                raise PlatformError(f"not engaged: {self._reason(wire) or 'engage first'}")
            if why := self._pause(now_ns) or self._trouble(wire):
                self._stopped, self._engaged = why, False  # in this order, for who reads without the lock
                self._in_charge = wire.owned()  # another owner's robot gets one zero and no more
                wire.drive(ZERO, time.time_ns())
                wire.release()  # who was cut off for long is not the owner that others have seen
                raise PlatformError(why)
            sent = replace(command, vz=0.0)
            age_ns = (self.clock.now_ns() - now_ns) / self.clock.speed
            wire.drive(sent, time.time_ns() - round(age_ns))
            self._sent_ns = now_ns
            return sent

    def state(self) -> PlatformState:
        """Return the newest odometry and battery state; the pose is in the robot's odometry frame."""
        wire, engaged = self._wire, self._engaged
        stopped = self._reason(wire)[:LONGEST_REASON]
        reading = wire.odometry if wire is not None else None
        if wire is None or reading is None:
            return PlatformState(t_ns=0, stopped=stopped)
        return PlatformState(
            t_ns=reading.t_ns,
            mode="DRIVE" if engaged else "READY",
            engaged=engaged,
            pose=reading.value.pose,
            velocity=reading.value.velocity,
            battery=self._charge(wire.battery),
            stopped=stopped,
            taken_over=self._taken,
        )

    def _charge(self, reading: Reading[float | None] | None) -> float | None:
        if reading is None:
            return None
        return fresh_or_none(reading.value, reading.t_ns, self.clock, self._timeouts.battery_timeout_s)

    def notices(self) -> tuple[str, ...]:
        """Return notices about malformed messages from the robot."""
        wire = self._wire
        count = wire.dropped if wire is not None else 0
        told, self._told = self._told, count
        dropped = f"{self.carrier}: {count} malformed messages were dropped"
        return (dropped,) if worth_logging(told, count) else ()

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
            reading = wire.odometry
            seen = reading is not None and reading.t_ns > asked_ns and _at_rest(reading.value.velocity)
            return seen or self._engaged or self._taken or self._wire is not wire

        if not until(stands, time.monotonic() + _REST_TIMEOUT_S):
            raise PlatformError(
                f"the robot was not seen to stand {_REST_TIMEOUT_S:g} s after the stop: "
                "stop it with its own remote control"
            )

    def close(self) -> None:
        """Make the robot stand and close the wire; does not wait for the robot."""
        self._give_back()
        with self._opening:
            with self._steering:
                wire, self._wire = self._wire, None
                self._engaged = self._in_charge = False
            if wire is not None:
                wire.close()

    def _connected(self) -> W:
        wire = self._wire
        if wire is None:
            raise PlatformError("the robot is not connected: connect first")
        return wire

    def _reason(self, wire: W | None) -> str:  # noqa: ARG002 -- for who knows better
        """Return why the robot is stopped."""
        return self._stopped

    def _trouble(self, wire: W) -> str:
        return self._suspends.trouble() or wire.trouble()

    def _pause(self, now_ns: int) -> str:
        """Latch a stop after the robot has timed out, so that the next command does not restart it."""
        paused_s = (now_ns - self._sent_ns) / 1e9 / self.clock.speed if self._sent_ns else 0.0
        over = paused_s > self._timeouts.command_timeout_s
        return f"no command for {paused_s:.2f} s: the robot has stopped by itself" if over else ""

    def _yield(self) -> None:
        """Leave the robot to its other commander, after one zero if it is driven; from any thread."""
        with self._steering:
            wire, driven = self._wire, self._engaged
            if wire is None or not self._in_charge:
                return
            self._taken, self._stopped = True, wire.rival()
            self._engaged = self._in_charge = False
            if driven:
                with contextlib.suppress(PlatformError):
                    wire.drive(ZERO, time.time_ns())

    def _withdraw(self, reason: str) -> None:
        self._stops += 1
        with self._steering:
            self._stopped = self._stopped or reason
            self._engaged = False

    def _give_back(self) -> W | None:
        """Make the robot stand and give up control; return its wire, None if it was not in our charge."""
        self._withdraw("")
        wire = self._wire
        if wire is None or not self._in_charge:
            return None
        self._send_zeros(wire)
        with self._steering:
            if self._may_stop(wire):
                wire.stand(time.time_ns())
                self._in_charge = False
        return wire

    def _may_stop(self, wire: W) -> bool:
        """Return whether the robot is still this side's, and nobody engaged again or closed meanwhile."""
        return self._in_charge and not self._engaged and self._wire is wire

    def _send_zeros(self, wire: W) -> None:
        for _ in range(_ZEROS):
            with self._steering:
                if not self._may_stop(wire):
                    return
                wire.drive(ZERO, time.time_ns())
            time.sleep(_ZERO_PERIOD_S)


def _at_rest(velocity: Twist) -> bool:
    return math.hypot(velocity.vx, velocity.vy) < _REST_M_S and abs(velocity.yaw_rate) < _REST_RAD_S
