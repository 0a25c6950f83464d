"""A whole platform on one page: a kinematic robot behind no wire, with the real rules of stopping.

Tests of the loop, the gate and the link use it; it passes the same conformance suite as a real adapter.
"""

from __future__ import annotations

import struct
import tempfile
import threading
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from adatracker_deploy.config.limits import Limits
from adatracker_deploy.config.profile import CameraSettings, Profile
from adatracker_deploy.config.schema import Range
from adatracker_deploy.core.errors import PlatformError
from adatracker_deploy.core.faults import ROBOT_SILENT
from adatracker_deploy.core.messages import LONGEST_REASON, ZERO, PlatformState, Twist
from adatracker_deploy.platform import Body, CameraMount, Check, Platform, Scenario, Sitl
from adatracker_deploy.sim.bodies import DriveSettings, KinematicBody

if TYPE_CHECKING:
    from adatracker_deploy.core.clock import Clock

_STEP_S = 0.01
_DEAF_S = 0.3
"""Machine time without a word from the robot after which it is driven no further."""
_COMMAND = struct.Struct("<dd")


def to_wire(command: Twist) -> bytes:
    """Return a command as both sides of the fake's wire say it: forward m/s and left-turning rad/s."""
    return _COMMAND.pack(command.vx, command.yaw_rate)


def from_wire(payload: bytes) -> Twist:
    """Return the command in what `to_wire` made."""
    vx, yaw_rate = _COMMAND.unpack(payload)
    return Twist(vx=vx, yaw_rate=yaw_rate)


@dataclass(frozen=True, slots=True, kw_only=True)
class FakeConnection:
    """The behaviour of the robot itself."""

    command_timeout_s: Annotated[float, Range(0.05, 5)] = 0.5
    """The robot stops by itself when the last command is older than this."""
    engage_s: Annotated[float, Range(0, 10)] = 0.5
    """Duration of engaging."""
    silence: str = ""
    """A file: the robot tells nothing while it is there. Empty for one that always tells."""


class FakeSimulator(Sitl):
    """Nothing is behind the wire: the fake platform is its own robot, but it can be made silent."""

    faults = (ROBOT_SILENT,)

    def __init__(self, profile: Profile) -> None:
        self._profile = profile
        self._folder = tempfile.TemporaryDirectory(prefix="fake-robot-")
        self._silence = Path(self._folder.name) / "silence"

    def start(self, clock: Clock, scenario: Scenario) -> Profile:  # noqa: ARG002 -- nothing here is random
        """Return the profile with what makes the robot silent in it."""
        connection = replace(self._profile.connection, silence=str(self._silence))
        return replace(self._profile, connection=connection)

    def order(self, line: str) -> None:
        """Be silent, or tell again."""
        if line.endswith(f" {ROBOT_SILENT.name}"):
            if line.startswith("begin"):
                self._silence.touch()
            else:
                self._silence.unlink(missing_ok=True)

    def close(self) -> None:
        """Leave nothing."""
        self._folder.cleanup()


class FakePlatform(Platform):
    """A robot that moves as its clock does: each look at it advances it to the present."""

    name = "fake"
    axes = frozenset({"vx", "yaw_rate"})
    Connection = FakeConnection
    SitlSettings = DriveSettings
    default_profile = "fake"

    def __init__(self, profile: Profile, clock: Clock) -> None:
        super().__init__(profile, clock)
        self.sent: list[Twist] = []
        """Everything that went out, oldest first."""
        self._body = KinematicBody(profile.sitl)
        self._lock = threading.RLock()
        self._now_ns = self._sent_ns = self._heard_ns = clock.now_ns()
        self._heard = (self._body.pose, self._body.velocity)
        self._command = ZERO
        self._connected = self._consent = self._engaged = False
        self._stopped = ""
        self._taken_over = False

    def connect(self) -> None:
        """Begin to hear the robot."""
        self._connected = True

    def preflight(self) -> tuple[Check, ...]:
        """Look at the robot's own time-out."""
        self._require_connection()
        timeout_s = self.profile.connection.command_timeout_s
        return (
            Check("command time-out", ok=True, message=f"the robot stops by itself after {timeout_s:g} s"),
        )

    def engage(self) -> None:
        """Take `engage_s`, during which any stop ends it."""
        with self._lock:
            self._require_connection()
            self._consent, self._stopped, self._taken_over = True, "", False
        until_ns = self.clock.now_ns() + round(self.profile.connection.engage_s * 1e9)
        while self._consent and (now_ns := self.clock.now_ns()) < until_ns:
            self.clock.sleep_until(min(until_ns, now_ns + 10_000_000))
        with self._lock:
            if not self._consent:
                raise PlatformError(f"engaging was stopped: {self._stopped or 'disengaged'}")
            self._engaged = True

    def send(self, command: Twist, now_ns: int) -> Twist:
        """Drive; sideways and upward parts are dropped."""
        if not command.is_finite():
            raise PlatformError(f"refused to send {command}: not finite")
        with self._lock:
            if not self._engaged:
                raise PlatformError(f"not engaged: {self._stopped or 'engage first'}")
            self._catch_up()
            if self._unheard_s() > _DEAF_S:
                self._latch("the robot is not heard any more")
                raise PlatformError(self._stopped)
            self._command, self._sent_ns = from_wire(to_wire(command)), now_ns
            self.sent.append(self._command)
            return self._command

    def state(self) -> PlatformState:
        """Return where the robot is now."""
        with self._lock:
            if not self._connected:
                return PlatformState(t_ns=0, stopped=self._stopped)
            self._catch_up()
            return PlatformState(
                t_ns=self._heard_ns,
                mode="DRIVE" if self._engaged else "IDLE",
                engaged=self._engaged,
                pose=self._heard[0],
                velocity=self._heard[1],
                battery=1.0,
                stopped=self._stopped,
                taken_over=self._taken_over,
            )

    def hold(self, reason: str) -> None:
        """Stop; the first reason stays."""
        with self._lock:
            self._catch_up()
            self._latch(reason)

    def take_over(self) -> None:
        """Take the robot over, as a pilot does."""
        self.hold("the pilot has taken over")
        self._taken_over = True

    def disengage(self) -> None:
        """Stop and be disabled."""
        self.hold("")

    def close(self) -> None:
        """Let go; a robot that still drives is stopped first."""
        self.disengage()
        self._connected = False

    @classmethod
    def body(cls, profile: Profile) -> Body:
        """Return the same dynamics on their own."""
        return KinematicBody(profile.sitl)

    @classmethod
    def sitl(cls, profile: Profile) -> Sitl:
        """Return the simulator that is not there."""
        return FakeSimulator(profile)

    def _require_connection(self) -> None:
        if not self._connected:
            raise PlatformError("the robot is not connected: connect first")

    def _latch(self, reason: str) -> None:
        if self._engaged:
            self.sent.append(ZERO)
        self._consent = self._engaged = False
        self._command, self._stopped = ZERO, self._stopped or reason[:LONGEST_REASON]

    def _unheard_s(self) -> float:
        return (self._now_ns - self._heard_ns) / 1e9 / self.clock.speed

    def _catch_up(self) -> None:
        now_ns = self.clock.now_ns()
        expires_ns = self._sent_ns + round(self.profile.connection.command_timeout_s * 1e9)
        while self._now_ns < now_ns:
            until_ns = min(now_ns, self._now_ns + round(_STEP_S * 1e9))
            command = self._command if self._now_ns < expires_ns else ZERO
            self._body.step(command, (until_ns - self._now_ns) / 1e9)
            self._now_ns = until_ns
        silence = self.profile.connection.silence
        if not (silence and Path(silence).exists()):
            self._heard_ns, self._heard = self._now_ns, (self._body.pose, self._body.velocity)


def fake_profile(connection: FakeConnection | None = None, sitl: DriveSettings | None = None) -> Profile:
    """Return a profile for `FakePlatform`: 1 m/s and 1 rad/s at most."""
    return Profile(
        name="fake",
        platform="fake",
        description="a kinematic robot behind no wire",
        limits=Limits(
            forward_m_s=1.0, backward_m_s=0.5, yaw_rate_rad_s=1.0, accel_m_s2=2.0, yaw_accel_rad_s2=4.0
        ),
        camera=CameraSettings(uri="world://simple_room"),
        connection=connection or FakeConnection(),
        sitl=sitl or DriveSettings(camera=CameraMount(up_m=1.0), lag_s=0.1),
    )
