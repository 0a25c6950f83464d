"""The wheeled base's adapter: sends velocity commands over a CAN bus, encoded by the profile's roles.

Blocking operations (connecting, enabling, coming to rest) share one lock. What must not wait (a stop, a
command, a takeover) goes through the `ControlAuthority`, so that a stop from another thread ends an engage at
once.
"""

from __future__ import annotations

import contextlib
import threading
from pathlib import Path
from typing import TYPE_CHECKING

from adatracker_deploy.core.errors import PlatformError, UsageError
from adatracker_deploy.core.log_throttle import worth_logging
from adatracker_deploy.core.messages import PlatformState, Twist
from adatracker_deploy.core.stamps import fresh_or_none
from adatracker_deploy.platform import Check, Platform
from adatracker_wheeled.adapter.authority import ControlAuthority
from adatracker_wheeled.adapter.engage import enable
from adatracker_wheeled.adapter.preflight import (
    battery_check,
    control_check,
    frames_check,
    queue_check,
    status_checks,
    timeout_check,
)
from adatracker_wheeled.adapter.receiver import BaseTelemetry, StopCause
from adatracker_wheeled.adapter.traffic import FORMATS, export_traffic
from adatracker_wheeled.adapter.transport import Wire
from adatracker_wheeled.protocol.connection import Connection

if TYPE_CHECKING:
    from adatracker_deploy.config.profile import Profile
    from adatracker_deploy.core.clock import Clock

_DISABLE_TIMEOUT_S = 0.2
_REST_TIMEOUT_S = 3.0
_POSE_TIMEOUT_S = 1.0
"""Without wheel data for this long the pose is unknown; bases send them 50 times a second."""
_BATTERY_PERIODS = 5
"""After this many missing battery messages the charge is unknown."""


class WheeledAdapter(Platform):
    """A base behind a CAN bus.

    After a takeover (by remote control, or an unrequested mode change) neither `hold` nor `disengage` nor
    `close` sends the base a frame, until an explicit `engage`.
    """

    name = "wheeled"
    axes = frozenset({"vx", "yaw_rate"})
    Connection = Connection
    default_profile = "scout"
    traffic_formats = FORMATS

    @classmethod
    def identity(cls, profile: Profile) -> str:
        """Name the base's bus: the same for every profile that reaches it from this machine."""
        return str(profile.connection.robot)

    def __init__(self, profile: Profile, clock: Clock) -> None:
        super().__init__(profile, clock)
        self._connection: Connection = profile.connection
        self._timing = self._connection.roles.timing
        self._battery_timeout_s = _BATTERY_PERIODS * self._timing.battery_period_s
        self._authority = ControlAuthority()
        self._turn = threading.Lock()
        self._closing = False
        self._sent_ns = 0
        self._told = 0
        """Number of malformed frames at the last notice."""
        self._warned: frozenset[str] = frozenset()
        """The base's warnings already reported; each once, however often it comes and goes."""

    def connect(self) -> None:
        """Open the bus and wait for the base's state; sends nothing.

        Raises:
            UsageError: the roles do not fit the DBC, or the connection's settings cannot work.
            PlatformError: the bus cannot be opened, or no state is heard within `silence_timeout_s`.
        """
        with self._turn:
            if self._authority.wire is not None:
                return
            wire = Wire(self._connection, self.profile.limits, self.clock, self._watch)
            try:
                wire.hear_state(self._refuse_when_closing)
            except BaseException:  # a Ctrl-C too must not leave the bus open
                wire.close()
                raise
            self._authority.wire = wire

    def preflight(self) -> tuple[Check, ...]:
        """Wait for a first motion and charge, then check the base's telemetry."""
        with self._turn:
            wire = self._connected()
            wire.wait(lambda heard: heard.motion_t_ns > 0, self._timing.feedback_timeout_s)
            wire.listen(self._refuse_when_closing)
            if self._connection.roles.battery and self._connection.min_battery:
                wire.wait(lambda heard: heard.battery is not None, 1.5 * self._timing.battery_period_s)
            return (
                *status_checks(wire.heard, self._timing, self.clock.now_ns(), self.clock.speed),
                control_check(wire.heard, wire.rival(), self._authority.in_charge, wire.mark.left_by()),
                battery_check(wire.heard.battery, self._connection.min_battery),
                timeout_check(self._timing),
                frames_check(wire.receiver.malformed),
                *self._queue_checks(),
            )

    def engage(self) -> None:
        """Send zeros, then request command mode; return once the base confirms it. Clears no error by itself.

        Opens the bus anew if it was lost.

        Raises:
            PlatformError: the base is not fit or does not obey, or somebody called `hold`, `disengage` or
                `close` meanwhile.
        """
        withdrawals = self._authority.withdrawals
        with self._turn:
            wire = self._connected()
            if self._authority.engaged:
                return
            self._authority.give_consent(withdrawals)
            try:
                if wire.lost:
                    wire.reopen()
                    wire.hear_state(self._authority.require_consent)
                self._sent_ns = 0
                enable(wire, self._authority, self._connection, self.clock)
            except (PlatformError, UsageError) as error:
                self._authority.withdraw(str(error))
                raise

    def send(self, command: Twist, now_ns: int) -> Twist:
        """Send one velocity; return what its frames really encode, clipped and rounded.

        Raises:
            PlatformError: the command is not finite, the base is not engaged, or it must not be driven on.
        """
        if not command.is_finite():
            raise PlatformError(f"refused to send {command}: not finite")
        wire = self._connected()
        with self._authority.lock:
            self._authority.on_fault(self._found(wire, now_ns) if self._authority.engaged else None)
            if not self._authority.engaged:
                raise PlatformError(f"not engaged: {self._authority.stopped or 'engage first'}")
            said = wire.command(command, now_ns)
            self._sent_ns = now_ns
            return said

    def state(self) -> PlatformState:
        """Return the newest telemetry; the pose is wheel odometry from where the base was first heard."""
        wire = self._authority.wire
        heard = wire.heard if wire is not None else BaseTelemetry()
        return PlatformState(
            t_ns=max(heard.status_t_ns, heard.motion_t_ns),
            mode=heard.status.mode_name if heard.status else "",
            engaged=self._authority.engaged,
            pose=fresh_or_none(heard.pose, heard.pose_t_ns, self.clock, _POSE_TIMEOUT_S),
            velocity=heard.motion,
            battery=fresh_or_none(heard.battery, heard.battery_t_ns, self.clock, self._battery_timeout_s),
            stopped=self._authority.stopped,
            taken_over=self._authority.taken_over,
        )

    def notices(self) -> tuple[str, ...]:
        """Return notices about the base's warnings, its malformed frames and the CAN log."""
        wire = self._authority.wire
        if wire is None:
            return ()
        count, status = wire.receiver.malformed, wire.heard.status
        told, self._told = self._told, count
        warnings = frozenset(filter(None, status.warning.split(", "))) if status is not None else frozenset()
        new, self._warned = warnings - self._warned, self._warned | warnings
        return (
            *((f"CAN: {count} malformed frames were dropped",) if worth_logging(told, count) else ()),
            *(f"the base warns of: {warning}" for warning in sorted(new)),
            *wire.traffic.notices(),
        )

    def record(self, folder: Path) -> None:
        """Write all CAN traffic from `connect` on into ``can.log`` of a trial's folder."""
        wire = self._authority.wire
        if wire is not None:
            wire.traffic.record(folder)

    @classmethod
    def export_traffic(cls, folder: Path, out: Path, ahead_ns: int) -> None:
        """Write a trial's CAN log as Vector's ``.asc`` or ``.blf``."""
        export_traffic(folder, out, ahead_ns)

    def hold(self, reason: str) -> None:
        """Send zero three times, then nothing until an explicit `engage`; the base stays enabled."""
        self._authority.withdraw(reason)
        wire = self._authority.wire
        if wire is not None:
            wire.finish()

    def disengage(self) -> None:
        """Send zeros, then request standby; return once the base stands.

        Raises:
            PlatformError: the bus is lost or too full to disable the base, or the base was not seen to stand
                within 3 s.
        """
        self._authority.withdraw()
        with self._turn:
            wire = self._authority.wire
            if wire is None or not self._authority.in_charge:
                return
            asked_ns = self.clock.now_ns()
            self._disable(wire)

            def stands(heard: BaseTelemetry) -> bool:
                return heard.motion_t_ns > asked_ns and heard.at_rest

            if not wire.wait(stands, _REST_TIMEOUT_S, self._refuse_when_closing):
                raise PlatformError(
                    f"the base was not seen to stand {_REST_TIMEOUT_S:g} s after the stop: "
                    "press its emergency stop"
                )

    def close(self) -> None:
        """Release the bus; a base that was left enabled is stopped and disabled first."""
        self._authority.withdraw()
        self._closing = True
        with self._turn:
            try:
                wire = self._authority.wire
                if wire is not None:
                    if self._authority.in_charge:
                        with contextlib.suppress(PlatformError):  # the base's own time-out is the last resort
                            self._disable(wire)
                    self._authority.wire = None
                    wire.close()
            finally:
                self._closing = False

    def _watch(self) -> None:
        """Stop as soon as a stop cause is received, and leave a base that is held to whoever takes it.

        Called from the receive thread.
        """
        with self._authority.lock:
            wire = self._authority.wire
            if wire is None:
                return
            if self._authority.engaged:
                self._authority.on_fault(wire.trouble(self.clock.now_ns()))
            elif self._authority.held and (found := wire.taken()):
                self._authority.on_fault(found)

    def _found(self, wire: Wire, now_ns: int) -> StopCause | None:
        """Check the base and other senders: a base that has stopped by itself is not restarted."""
        silent_s = (now_ns - self._sent_ns) / 1e9 / self.clock.speed if self._sent_ns else 0.0
        if silent_s > self._timing.base_timeout_s:
            return StopCause(f"no command for {silent_s:.2f} s: the base has stopped by itself")
        return wire.trouble(now_ns)

    def _disable(self, wire: Wire) -> None:
        """Send the zeros, then disable the base; until that is sent this side stays in charge."""
        wire.finish()
        if not wire.wait(lambda _: self._given_back(wire), _DISABLE_TIMEOUT_S):
            raise PlatformError(
                "the base is still enabled: the CAN bus took no request to disable it; "
                "disengage again or press its emergency stop"
            )

    def _given_back(self, wire: Wire) -> bool:
        """Send one disable request; return whether the base is released."""
        with self._authority.lock:
            mine, self._authority.in_charge = (
                self._authority.in_charge,
                False,
            )  # for good if `offer` finds the bus lost
            if mine:  # nobody has taken it meanwhile
                self._authority.in_charge = not wire.offer(wire.codec.disable())
                if not self._authority.in_charge:
                    wire.mark.clear()
            return not self._authority.in_charge

    def _queue_checks(self) -> tuple[Check, ...]:
        channel = str(self._connection.channel)
        length = Path("/sys/class/net", channel, "tx_queue_len")
        if self._connection.interface != "socketcan" or not length.is_file():
            return ()
        return (queue_check(channel, int(length.read_text(encoding="ascii"))),)

    def _connected(self) -> Wire:
        if self._authority.wire is None:
            raise PlatformError("the base is not connected: connect first")
        return self._authority.wire

    def _refuse_when_closing(self) -> None:
        if self._closing:
            raise PlatformError("the connection is being closed")
