"""The rover's adapter: the rules of driving it, behind one lock.

A stop ends an engage at once, because waiting gives the lock away; no DRIVE follows a STOP, because both are
sent under it. Time-outs of the wire are the machine's seconds, at any speed of the clock.
"""

from __future__ import annotations

import contextlib
import enum
import threading
from typing import TYPE_CHECKING

from adatracker_deploy import Check, Platform, PlatformError, PlatformState, Twist

from adatracker_rover.adapter.transport import Wire
from adatracker_rover.protocol.connection import Connection
from adatracker_rover.protocol.messages import Ask, Mode, Report, Request, quantise

if TYPE_CHECKING:
    from collections.abc import Callable

    from adatracker_deploy import Clock, Profile

LONGEST_TIMEOUT_S = 0.5
"""At 1.5 m/s the rover rolls 0.75 m until its own time-out stops it, when all else has failed."""
_ASK_EVERY_S = 0.1
_ASKS = 15
"""Datagrams get lost, so the rover is asked again; after 1.5 s it does not answer."""


class _Charge(enum.Enum):
    """The controller of the rover."""

    NONE = enum.auto()
    """Not ours: it is left alone."""
    ENGAGING = enum.auto()
    ENGAGED = enum.auto()
    STOPPING = enum.auto()
    """It was ours and has not confirmed its stop."""


class RoverAdapter(Platform):
    """A rover behind UDP."""

    name = "rover"
    axes = frozenset({"vx", "yaw_rate"})
    Connection = Connection
    default_profile = "rover"

    def __init__(self, profile: Profile, clock: Clock) -> None:
        super().__init__(profile, clock)
        self._connection: Connection = profile.connection
        self._changed = threading.Condition()  # guards what follows; notified when any of it changes
        self._wire: Wire | None = None
        self._heard: tuple[Report, int] | None = None
        """The newest report, and when it came; replaced as one, so that it can be read without the lock."""
        self._charge = _Charge.NONE
        self._stopped = ""
        self._taken_over = False

    def connect(self) -> None:
        """Open the socket and wait for the first report; moves nothing.

        Raises:
            UsageError: the address cannot be one.
            PlatformError: nobody answers there.
        """
        host, port = self._connection.host, self._connection.port
        with self._changed:
            if self._wire is not None:
                return
            self._wire = Wire(host, port, self._hear)
            answered = self._ask_until(Ask.REPORT, lambda _: True)
        if not answered:
            self.close()
            raise PlatformError(
                f"no rover answers at {host}:{port}: switch it on, join its network, "
                "and compare connection.host and connection.port in the profile"
            )

    def preflight(self) -> tuple[Check, ...]:
        """Judge the newest report: the rover's own time-out above all, which is the stop of last resort."""
        report = self._require_report()
        timeout_s, least = report.timeout_s, self._connection.min_battery
        fit = 0 < timeout_s <= LONGEST_TIMEOUT_S
        told = f"it is {timeout_s:g} s" if timeout_s else "it is off"
        mend = "" if fit else f": set it, in the rover, to {LONGEST_TIMEOUT_S:g} s or less"
        return (
            Check("command time-out", fit, told + mend),
            Check("battery", report.battery >= least, f"{report.battery:.0%} left, {least:.0%} needed"),
            Check("remote control", report.mode is not Mode.REMOTE, f"the rover obeys {report.mode.name}"),
        )

    def engage(self) -> None:
        """Enable the rover and return once it says that it obeys.

        Raises:
            PlatformError: it does not, or somebody called `hold`, `disengage` or `close` meanwhile.
        """
        with self._changed:
            report = self._require_report()
            if self._charge is _Charge.ENGAGED:
                return
            if report.mode is Mode.REMOTE:
                raise PlatformError("somebody drives the rover by remote control: switch that off first")
            self._charge, self._stopped, self._taken_over = _Charge.ENGAGING, "", False
            # Only a rover that was heard to be stopped can be heard to start: an old report may say DRIVE.
            braked = self._ask_until(Ask.STOP, lambda report: report.braked)
            obeys = braked and self._ask_until(Ask.ENABLE, lambda report: not report.braked)
            if self._charge is not _Charge.ENGAGING:
                raise PlatformError(f"engaging was stopped: {self._stopped or 'disengaged'}")
            self._charge = _Charge.ENGAGED if obeys else _Charge.STOPPING
            if not obeys:
                raise PlatformError("the rover does not go to DRIVE: switch it off and on, and try again")

    def send(self, command: Twist, now_ns: int) -> Twist:
        """Send one velocity; return it as the wire says it, without sideways and upward parts.

        Raises:
            PlatformError: the command is not finite, the rover is not engaged, or it is no longer heard.
        """
        if not command.is_finite():
            raise PlatformError(f"refused to send {command}: not finite")
        with self._changed:
            silent_s = (now_ns - (self._heard[1] if self._heard else 0)) / 1e9 / self.clock.speed
            if self._charge is _Charge.ENGAGED and silent_s > self._connection.report_timeout_s:
                self._latch(_Charge.STOPPING, f"no report from the rover for {silent_s:.1f} s")
            if self._charge is not _Charge.ENGAGED:
                raise PlatformError(f"not engaged: {self._stopped or 'engage first'}")
            sent = quantise(command)
            self._send(Request(Ask.DRIVE, sent))
            return sent

    def state(self) -> PlatformState:
        """Return the newest report; takes no lock, for a wire whose `send` waits for an answer holds it."""
        heard = self._heard
        if heard is None:
            return PlatformState(t_ns=0, stopped=self._stopped)
        report, heard_ns = heard
        return PlatformState(
            t_ns=heard_ns,
            mode=report.mode.name,
            engaged=self._charge is _Charge.ENGAGED,
            pose=report.pose,
            velocity=report.velocity,
            battery=report.battery,
            stopped=self._stopped,
            taken_over=self._taken_over,
        )

    def hold(self, reason: str) -> None:
        """Stop the rover and return once it says that it brakes."""
        self._stop(reason, lambda report: report.braked)

    def disengage(self) -> None:
        """Stop the rover, return once it stands, and leave it alone from then on."""
        self._stop("", lambda report: report.at_rest)

    def close(self) -> None:
        """Stop the rover if it is still ours, and let go of the socket and the thread."""
        with contextlib.suppress(PlatformError):  # the rover's own time-out is the last resort
            self.disengage()
        with self._changed:
            wire, self._wire, self._charge = self._wire, None, _Charge.NONE
            self._changed.notify_all()
        if wire is not None:
            wire.close()  # without the lock, which its thread may wait for
            self._heard = None

    def _stop(self, reason: str, done: Callable[[Report], bool]) -> None:
        """Latch, and ask a rover that is ours to stop until it reports that it is `done`."""
        with self._changed:
            ours = self._charge is not _Charge.NONE
            self._latch(_Charge.STOPPING if ours else _Charge.NONE, reason)
            if not ours:
                return
            confirmed = self._ask_until(Ask.STOP, done)
            if self._charge is not _Charge.STOPPING:  # a person or another thread has seen to it
                return
            if not confirmed:
                raise PlatformError("the rover does not confirm its stop: press its stop button")
            if self._report is not None and self._report.at_rest:
                self._charge = _Charge.NONE

    def _latch(self, charge: _Charge, reason: str, *, taken_over: bool = False) -> None:
        """Let no DRIVE out any more, until an explicit engage; the first reason stays."""
        if not self._stopped:
            self._stopped, self._taken_over = reason[:95], taken_over
        self._charge = charge  # last, for who reads without the lock
        self._changed.notify_all()

    def _hear(self, report: Report) -> None:
        """Take in a report, in the wire's thread; an unrequested mode latches a stop."""
        with self._changed:
            self._heard = report, self.clock.now_ns()
            if report.mode is Mode.REMOTE and self._charge is not _Charge.NONE:
                self._latch(_Charge.NONE, "somebody took the rover over by remote control", taken_over=True)
            elif report.braked and self._charge is _Charge.ENGAGED:
                self._latch(_Charge.STOPPING, f"the rover itself went to {report.mode.name}", taken_over=True)
            self._changed.notify_all()

    def _ask_until(self, ask: Ask, answered: Callable[[Report], bool]) -> bool:
        """Ask until a report is the answer, or the rover has changed hands; tell whether it was answered.

        The lock is held when this is called, and given away while it waits.
        """
        wire, charge = self._wire, self._charge

        def over() -> bool:
            changed_hands = self._wire is not wire or self._charge is not charge
            return changed_hands or (self._report is not None and answered(self._report))

        for _ in range(_ASKS):
            with contextlib.suppress(PlatformError):  # the next try may get through
                self._send(Request(ask))
            if self._changed.wait_for(over, _ASK_EVERY_S):
                break
        return self._report is not None and answered(self._report)

    @property
    def _report(self) -> Report | None:
        return self._heard[0] if self._heard else None

    def _send(self, request: Request) -> None:
        if self._wire is not None:  # a rover that was let go of meanwhile is not asked for anything
            self._wire.send(request)

    def _require_report(self) -> Report:
        report = self._report
        if report is None:
            raise PlatformError("the rover is not connected: connect first")
        return report
