"""The link: the sole owner of gate and platform, stepped at 50 Hz, and at once for a new set-point.

It takes the newest set-point, judges it, sends it, and reports what it did. Without set-points it sends zero,
then holds, then disengages; it never starts again by itself. `link_process` runs it in its own process; tests
and lock-step runs step the same code in theirs.
"""

from __future__ import annotations

import enum
import queue
import threading
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal

from adatracker_deploy.config.limits import Limits
from adatracker_deploy.core.errors import PlatformError, line_of
from adatracker_deploy.core.messages import ZERO, PlatformState, Twist
from adatracker_deploy.platform import Platform
from adatracker_deploy.runtime.gate import (
    GateState,
    Reason,
    Setpoint,
    Stage,
    Stop,
    Verdict,
    judge,
    unmonitored,
)
from adatracker_deploy.runtime.suspend import SuspendWatch

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from adatracker_deploy.core.clock import Clock

RATE_HZ = 50.0
_MANOEUVRES = 3
"""Engage, hold and disengage: each at most once, possibly at the same time."""
_AGAIN_S = 0.02
"""Interval between attempts to end an engagement that has only just begun, s."""

Level = Literal["info", "warning", "error"]


class Phase(enum.StrEnum):
    """The robot's phase between connect and close."""

    IDLE = "idle"
    ENGAGING = "engaging"
    ACTIVE = "active"
    HOLDING = "holding"
    DISENGAGING = "disengaging"
    DONE = "done"


_DRIVEN = (Phase.ACTIVE, Phase.HOLDING)
"""Phases in which the gate judges."""


@dataclass(frozen=True, slots=True)
class Event:
    """An event for the log."""

    t_ns: int
    level: Level
    message: str


@dataclass(frozen=True, slots=True)
class Acted:
    """The newest set-point sent to the robot, and when it was first sent; ns of the run's clock."""

    setpoint_ns: int
    """The set-point's own time, which identifies it."""
    judged_ns: int
    """Time at which the gate had judged it."""
    sent_ns: int
    """Time at which the adapter had taken it: written to a socket, or handed to the adapter's own sender."""


@dataclass(frozen=True, slots=True)
class LinkStatus:
    """The link's last action, and the robot's own state."""

    phase: Phase
    state: PlatformState
    sent: Twist = ZERO
    reasons: tuple[str, ...] = ()
    """Reasons for the difference from the request, by the names of `gate.Reason`; empty without one."""
    stopped: str = ""
    """Reason for a latched stop, in words for people; empty without a stop."""
    takeover: bool = False
    """Somebody else has control: see `PlatformState.taken_over`."""
    t_ns: int = 0
    acted: Acted | None = None
    """None before the first set-point."""


class Link:
    """Supervises one connected platform.

    Args:
        platform: connected; engaging and disengaging block, so they run in `spawn`.
        limits: the profile's, in the run's clock.
        clock: the run's.
        newest: returns the newest set-point or None.
        spawn: runs a blocking manoeuvre; in a waiting thread by default, inline in lock-step runs.
    """

    def __init__(
        self,
        platform: Platform,
        limits: Limits,
        clock: Clock,
        newest: Callable[[], Setpoint | None],
        spawn: Callable[[Callable[[], None]], None] | None = None,
    ) -> None:
        self._platform = platform
        self._limits = limits
        self._clock = clock
        self._newest = newest
        self._spawn = spawn or StandbyThreads(_MANOEUVRES)
        self._gate = GateState(armed_ns=clock.now_ns())
        self._suspends = SuspendWatch(clock)
        self._engaging_over = threading.Event()
        self._lock = threading.Lock()
        self._events: list[Event] = []
        self._warned: tuple[Reason, ...] = ()
        self.status = LinkStatus(Phase.IDLE, platform.state())

    def engage(self) -> None:
        """Start engaging; `status.phase` becomes ACTIVE, or DONE with a reason."""
        with self._lock:
            if self.status.phase is not Phase.IDLE:
                return
            self._suspends.begin()
            self._gate = GateState(armed_ns=self._clock.now_ns())
            self._enter(Phase.ENGAGING)
        self._spawn(self._engage)

    def hold(self, reason: str) -> None:
        """Stop; latches. A robot that is still engaging cannot hold, and is disengaged."""
        self._halt(Stop(Reason.ASKED, reason))

    def disengage(self, reason: str) -> None:
        """Disengage in the robot's safe way, from any phase; `status.phase` ends as DONE."""
        self._give_up(Stop(Reason.ASKED, reason))

    def record(self, folder: Path) -> None:
        """Let the robot's wire write its traffic into a trial's folder."""
        try:
            self._platform.record(folder)
        except Exception as error:  # no log is worth a robot's link
            self.note(
                "warning", f"the wire's traffic is not logged: {type(error).__name__}: {line_of(error)}"
            )

    def step(self, now_ns: int) -> LinkStatus:
        """Run one step at `now_ns`; return the new status."""
        driven = self.status.phase in _DRIVEN  # before the state is read: an older state says "not engaged"
        self._watch_machine()
        state, notices = self._platform.state(), self._platform.notices()
        with self._lock:
            for notice in notices:
                self.note("warning", notice)
            phase = self.status.phase
            self.status = replace(self.status, state=state, t_ns=now_ns)
            judged = self._judge(state, now_ns) if driven and phase in _DRIVEN else None
        if judged is not None:
            self._carry_out(*judged, phase, now_ns)
        elif phase is Phase.ENGAGING and (stop := self._lost(state, now_ns)):
            self._give_up(stop)
        return self.status

    def drain_events(self) -> list[Event]:
        """Return the events since the last call."""
        with self._lock:
            events, self._events = self._events, []
        return events

    def note(self, level: Level, message: str) -> None:
        """Record an event."""
        self._events.append(Event(self._clock.now_ns(), level, message))

    def _judge(self, state: PlatformState, now_ns: int) -> tuple[Verdict, Setpoint | None]:
        setpoint = self._newest()
        now_ns = max(now_ns, self._clock.now_ns())  # later than whatever the set-point was made from
        self._gate, verdict = judge(self._limits, self._gate, setpoint, state, now_ns)
        return verdict, setpoint

    def _carry_out(self, verdict: Verdict, setpoint: Setpoint | None, phase: Phase, now_ns: int) -> None:
        self._warn(verdict.warnings)
        stop = self._gate.stop
        if stop is None:  # which a link that holds always has
            self._send(verdict, setpoint, now_ns)
        elif phase is Phase.ACTIVE:
            self._halt(stop)
        elif verdict.stage is Stage.DISENGAGE:
            self._give_up(stop)

    def _lost(self, state: PlatformState, now_ns: int) -> Stop | None:
        """Return who has fallen silent while the robot engages: the tracker, or the robot itself."""
        setpoint, begun_ns = self._newest(), self._gate.armed_ns
        told_ns, heard_ns = max(setpoint.t_ns if setpoint else 0, begun_ns), max(state.t_ns, begun_ns)
        if (now_ns - told_ns) / 1e9 > self._limits.disengage_after_s:
            return Stop(Reason.COMMAND_LOST)
        silent_s, watched = (now_ns - heard_ns) / 1e9, Reason.STATE_LOST not in self._limits.switched_off
        return Stop(Reason.STATE_LOST) if watched and silent_s > self._limits.state_timeout_s else None

    def _send(self, verdict: Verdict, setpoint: Setpoint | None, now_ns: int) -> None:
        judged_ns = self._clock.now_ns()
        try:
            sent = self._platform.send(verdict.twist, now_ns)
        except PlatformError as error:
            self._halt(Stop(Reason.REFUSED, str(error)))
            return
        acted = self.status.acted
        if setpoint is not None and (acted is None or acted.setpoint_ns != setpoint.t_ns):
            acted = Acted(setpoint.t_ns, judged_ns, self._clock.now_ns())
        with self._lock:
            self.status = replace(self.status, sent=sent, reasons=verdict.reasons, acted=acted)

    def _watch_machine(self) -> None:
        """Stop if the machine was suspended: frames and commands that look fresh are old."""
        if why := self._suspends.trouble():
            self._halt(Stop(Reason.SUSPENDED, f"suspended: {why}"))

    def _halt(self, stop: Stop) -> None:
        """Latch a stop and hold; a robot that has stopped by itself is left as it is."""
        with self._lock:
            phase = self.status.phase
            if phase is Phase.ACTIVE:
                self._enter(Phase.HOLDING, stop)
        if phase is Phase.ENGAGING:
            self._give_up(stop)
        elif phase is Phase.ACTIVE and stop.reason not in (Reason.ROBOT_STOPPED, Reason.TAKEOVER):
            self._spawn(lambda: self._hold(stop.text))

    def _give_up(self, stop: Stop) -> None:
        """Disengage for good; the first stop's reason is kept."""
        with self._lock:
            phase = self.status.phase
            if phase in (Phase.DISENGAGING, Phase.DONE):
                return
            self._enter(Phase.DONE if phase is Phase.IDLE else Phase.DISENGAGING, self._gate.stop or stop)
        if phase is not Phase.IDLE:
            self._spawn(self._disengage)

    def _warn(self, warnings: tuple[Reason, ...]) -> None:
        """Note each warning when it begins."""
        for warning in warnings:
            if warning not in self._warned:
                self.note("warning", warning)
        self._warned = warnings

    def _enter(self, phase: Phase, stop: Stop | None = None) -> None:
        unasked = stop is not None and stop.reason is not Reason.ASKED
        level: Level = "warning" if unasked and phase is Phase.HOLDING else "info"
        self.note(level, f"{phase}: {stop.text}" if stop else str(phase))
        self._gate = replace(self._gate, stop=stop)
        self.status = replace(
            self.status,
            phase=phase,
            sent=self.status.sent if phase is Phase.ACTIVE else ZERO,
            reasons=(stop.reason,) if stop else (),
            stopped=stop.text if stop else "",
            takeover=self.status.takeover or (stop is not None and stop.reason is Reason.TAKEOVER),
        )

    def _engage(self) -> None:
        with self._lock:
            wanted = self.status.phase is Phase.ENGAGING  # a stop may have been quicker than this thread
        error = self._try("engage", self._platform.engage) if wanted else None
        self._engaging_over.set()
        with self._lock:
            if self.status.phase is not Phase.ENGAGING:
                return
            if error is None:
                self._gate = GateState(armed_ns=self._clock.now_ns())
                self._enter(Phase.ACTIVE)
                for reason in unmonitored(self._limits, self._platform.state()):
                    self.note("info", f"{reason} is not monitored: the robot does not report what it needs")
                return
        self.disengage(error or "")

    def _hold(self, reason: str) -> None:
        self._try("hold", lambda: self._platform.hold(reason))

    def _disengage(self) -> None:
        """Disengage; repeat if engaging was still in progress, because an engage undoes a stop."""
        settled = False
        while not settled:
            settled = self._engaging_over.is_set()
            self._try("disengage", self._platform.disengage)
            if not settled:
                self._engaging_over.wait(_AGAIN_S)
        with self._lock:
            self._enter(Phase.DONE, self._gate.stop)

    def _try(self, what: str, manoeuvre: Callable[[], None]) -> str | None:
        """Run a manoeuvre; a failure is recorded as an event and returned, since threads lose errors."""
        try:
            manoeuvre()
        except PlatformError as error:
            reason = str(error)
        except Exception as error:  # an adapter's bug must still lead to a stop
            reason = f"{type(error).__name__}: {line_of(error)}"
        else:
            return None
        self.note("error", f"{what}: {reason}")
        return reason


class StandbyThreads:
    """A pool of waiting threads: a machine out of memory could not start one to stop a robot.

    Args:
        count: the largest number of concurrent jobs.
    """

    def __init__(self, count: int) -> None:
        self._jobs: queue.SimpleQueue[Callable[[], None]] = queue.SimpleQueue()
        for number in range(count):
            threading.Thread(target=self._work, name=f"standby {number}", daemon=True).start()

    def __call__(self, job: Callable[[], None]) -> None:
        """Run a job in the first free thread."""
        self._jobs.put(job)

    def _work(self) -> None:
        while True:
            self._jobs.get()()
