"""Runs the link in its own process, so that it outlives a tracker that hangs, stops or dies.

Set-points and status pass through shared memory (latest only); requests, answers and events through a pipe. A
bell wakes the link for a set-point or a request, which would wait for its next slot otherwise.
When the pipe closes, the tracker has died: the link then holds, disengages and exits.
"""

from __future__ import annotations

import contextlib
import dataclasses
import gc
import multiprocessing
import os
import signal
import threading
import time
from multiprocessing import resource_tracker
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

from adatracker_deploy.config.limits import Limits
from adatracker_deploy.core.errors import PlatformError, UsageError, line_of
from adatracker_deploy.platform import Check, Platform
from adatracker_deploy.runtime.bell import Bell, Ear
from adatracker_deploy.runtime.black_box import BlackBox
from adatracker_deploy.runtime.gate import Setpoint
from adatracker_deploy.runtime.link import RATE_HZ, Event, Link, LinkStatus, Phase
from adatracker_deploy.runtime.mailbox import Mailbox
from adatracker_deploy.runtime.pacer import Pacer
from adatracker_deploy.runtime.pulse import LINK_LOST, Pulse
from adatracker_deploy.runtime.scheduling import LINK_PRIORITY, ORDINARY, Scheduling
from adatracker_deploy.runtime.service_watchdog import ServiceWatchdog
from adatracker_deploy.runtime.wire import (
    SETPOINT_BYTES,
    STATUS_BYTES,
    pack_setpoint,
    pack_status,
    unpack_setpoint,
    unpack_status,
)

if TYPE_CHECKING:
    from collections.abc import Iterator
    from multiprocessing.connection import Connection
    from types import TracebackType

    from adatracker_deploy.config.profile import Profile
    from adatracker_deploy.core.clock import Clock

CONNECT_TIMEOUT_S = 40.0
_JOIN_S = 0.05
GONE = "tracker_gone"
PROCESS_NAME = "adatracker-link"


class LinkProcess:
    """The tracker's handle on the link process.

    As a context manager it disengages a robot that is still engaged.
    """

    def __init__(
        self,
        platform: type[Platform],
        profile: Profile,
        clock: Clock,
        scheduling: Scheduling = ORDINARY,
    ) -> None:
        self._clock = clock
        context = multiprocessing.get_context("spawn")
        setpoints = context.RawArray("B", Mailbox.size(SETPOINT_BYTES))
        statuses = context.RawArray("B", Mailbox.size(STATUS_BYTES))
        self._setpoints = Mailbox(setpoints, SETPOINT_BYTES)
        self._statuses = Mailbox(statuses, STATUS_BYTES)
        self._pipe, simulator = context.Pipe()
        ear, bell = context.Pipe(duplex=False)
        self._bell = Bell(bell)
        self._events: list[Event] = []
        self._connected = False
        self._pulse = Pulse()
        self._process = context.Process(
            target=_main,
            args=(platform, profile, clock, scheduling, setpoints, statuses, simulator, ear),
            name="link",
        )
        with _deaf_to_the_terminal():
            self._process.start()
        simulator.close()
        ear.close()

    @property
    def pid(self) -> int:
        """The link's process id."""
        return self._process.pid or 0

    def connect(self) -> tuple[Check, ...]:
        """Wait until the link has connected; return the robot's preflight.

        Raises:
            UsageError: the connection's settings cannot work.
            PlatformError: the robot does not answer, or the link process died.
        """
        deadline = time.monotonic() + CONNECT_TIMEOUT_S
        while time.monotonic() < deadline:
            message = self._receive(timeout_s=0.05)
            if message is None:
                continue
            kind, value = message
            if kind == "connected":
                self._connected = True
                return tuple(value)
            if kind == "usage_error":
                raise UsageError(value)
            if kind == "platform_error":
                raise PlatformError(value)
        raise PlatformError(f"the robot's link did not come up within {CONNECT_TIMEOUT_S:g} s")

    def engage(self) -> None:
        """Request engaging; `status().phase` shows when it is done."""
        self._ask("engage", "")

    def send(self, setpoint: Setpoint) -> None:
        """Publish a set-point; never blocks."""
        self._setpoints.write(pack_setpoint(setpoint))
        self._bell.ring()

    def hold(self, reason: str) -> None:
        """Request a latched stop."""
        self._ask("hold", reason)

    def disengage(self, reason: str) -> None:
        """Request disengaging; `status().phase` shows when it is done."""
        self._ask("disengage", reason)

    def record(self, path: Path) -> None:
        """Request a black box at `path`, which must not exist yet, and the wire's traffic beside it."""
        self._ask("record", str(path))

    def status(self) -> LinkStatus | None:
        """Return the link's newest status, or None before its first step."""
        message = self._statuses.read()
        return None if message is None else unpack_status(message)

    def alive(self) -> bool:
        """Return whether the link process runs and still updates its status; to be polled."""
        status = self.status()
        self._pulse = self._pulse.look(status.t_ns if status else None, time.monotonic())
        return self._process.is_alive() and self._pulse.beats

    def drain_events(self) -> list[Event]:
        """Return the link's events since the last call."""
        with contextlib.suppress(PlatformError):
            while self._receive(timeout_s=0) is not None:
                pass
        events, self._events = self._events, []
        return events

    def close(self, timeout_s: float = 60.0) -> None:
        """Disengage if needed, end the process and wait for it; may be called twice.

        A link that has not connected ends at once. One that hangs is killed, so that it cannot wake up later
        and disturb the robot's own fail-safe.
        """
        self._ask("close", "closed")
        if not self._connected:
            self._process.terminate()
        deadline_s = time.monotonic() + timeout_s
        while self._process.is_alive() and time.monotonic() < deadline_s and (self._at_end() or self.alive()):
            self._process.join(_JOIN_S)
        if self._process.is_alive():
            self._process.kill()
            self._process.join()
        self._pipe.close()
        self._bell.close()

    def _at_end(self) -> bool:
        """Return whether the link is done and is only closing its connection."""
        status = self.status()
        return status is not None and status.phase is Phase.DONE

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _ask(self, request: str, reason: str) -> None:
        with contextlib.suppress(OSError):  # `alive` reports a dead link; a request to it is not an error
            self._pipe.send((request, reason))
        self._bell.ring()

    def _receive(self, timeout_s: float) -> tuple[str, Any] | None:
        try:
            if not self._pipe.poll(timeout_s):
                return None
            kind, value = self._pipe.recv()
        except (OSError, EOFError) as error:
            raise PlatformError(LINK_LOST) from error
        if kind == "event":
            self._events.append(value)
        return kind, value


@contextlib.contextmanager
def _deaf_to_the_terminal() -> Iterator[None]:
    """Block Ctrl-C and hangups for a process started within, until it has left this session."""
    resource_tracker.ensure_running()  # with the first process otherwise, and that would end the blocking
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT, signal.SIGHUP})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _main(  # noqa: PLR0917 -- what a new process is given comes by position
    platform_class: type[Platform],
    profile: Profile,
    clock: Clock,
    scheduling: Scheduling,
    setpoints: Any,
    statuses: Any,
    pipe: Connection,
    ear: Connection,
) -> None:
    os.setsid()  # Ctrl-C and Ctrl-Z in the tracker's terminal must not reach the link
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    with contextlib.suppress(OSError):  # so that an operator can find it; other systems have no such file
        Path("/proc/self/comm").write_text(PROCESS_NAME, encoding="ascii")
    platform = platform_class(profile, clock)
    try:
        scheduling.take(LINK_PRIORITY)  # before the adapter starts its threads, which inherit it
        platform.connect()
        checks = platform.preflight()
    except (UsageError, PlatformError) as error:
        kind = "usage_error" if isinstance(error, UsageError) else "platform_error"
        _tell(pipe, kind, str(error))
        platform.close()
        return
    inbox, outbox = Mailbox(setpoints, SETPOINT_BYTES), Mailbox(statuses, STATUS_BYTES)

    def newest() -> Setpoint | None:
        message = inbox.read()
        return None if message is None else unpack_setpoint(message)

    link = Link(platform, wall_timeouts(profile.limits, clock.speed), clock, newest)
    terminated = threading.Event()
    signal.signal(signal.SIGTERM, lambda *_: terminated.set())
    gc.collect()
    gc.freeze()  # a full collection of a warm process takes longer than a slot
    outbox.write(pack_status(link.status))
    _tell(pipe, "connected", checks)
    watchdog = ServiceWatchdog()
    watchdog.begin()
    try:
        slots = Slots(clock, Ear(ear))
        _serve(link, slots, pipe, watchdog, inbox=inbox, outbox=outbox, terminated=terminated)
    finally:
        platform.close()
        watchdog.rest()


def wall_timeouts(limits: Limits, speed: float) -> Limits:
    """Scale the time-outs to the run's clock, so that a loss is noticed after the same machine time at any
    speed."""
    return dataclasses.replace(
        limits,
        command_timeout_s=limits.command_timeout_s * speed,
        sight_timeout_s=limits.sight_timeout_s * speed,
        hold_after_s=limits.hold_after_s * speed,
        disengage_after_s=limits.disengage_after_s * speed,
        state_timeout_s=limits.state_timeout_s * speed,
    )


class Slots:
    """When the link is stepped: 50 times a second, and once between two slots when the bell rings."""

    def __init__(self, clock: Clock, ear: Ear) -> None:
        self._clock, self._ear, self._pacer = clock, ear, Pacer(clock, RATE_HZ)
        self._between = False

    def wait(self) -> int:
        """Wait for the next step; return the time, ns of the clock."""
        left_s = (self._pacer.due_ns - self._clock.now_ns()) / 1e9 / self._clock.speed
        self._between = not self._between and left_s > 0 and self._ear.heard(left_s)
        if self._between:
            return self._clock.now_ns()
        now_ns = self._pacer.wait().t_ns
        self._ear.heard(0.0)  # what has rung until now is seen to in this step
        return now_ns


def _serve(
    link: Link,
    slots: Slots,
    pipe: Connection,
    watchdog: ServiceWatchdog,
    *,
    inbox: Mailbox,
    outbox: Mailbox,
    terminated: threading.Event,
) -> None:
    """Step the link until it is closed and the robot has come to rest."""
    closing = False
    box: BlackBox | None = None

    def tell(status: LinkStatus) -> None:
        packed = pack_status(status)
        outbox.write(packed)
        if box is not None:
            box.record(inbox.read(), packed)
        for event in link.drain_events():
            _tell(pipe, "event", event)

    while not (closing and link.status.phase is Phase.DONE):
        now_ns = slots.wait()
        try:
            while not closing and pipe.poll():
                request, words = pipe.recv()
                if request == "record":
                    box = _black_box(words, link)
                    link.record(Path(words).parent)
                else:
                    closing = _obey(link, request, words)
        except (OSError, EOFError):
            closing = True
            link.disengage(GONE)
        if terminated.is_set() and not closing:
            closing = True
            link.disengage("terminated")
        try:
            status = link.step(now_ns)
        except Exception as error:  # whatever fails here, the robot must be brought to rest
            link.note("error", f"link: {type(error).__name__}: {line_of(error)}")
            link.disengage("link_fault")
            status = link.status
        tell(status)
        watchdog.feed()
    tell(link.status)  # it may have ended since the last step
    if box is not None:
        box.close()


def _black_box(path: str, link: Link) -> BlackBox | None:
    try:
        return BlackBox(Path(path))
    except OSError as error:
        link.note("warning", f"no black box: {path} cannot be written ({error.strerror})")
        return None


def _obey(link: Link, request: str, reason: str) -> bool:
    """Carry out one request; return whether it was the last."""
    if request == "engage":
        link.engage()
    elif request == "hold":
        link.hold(reason)
    else:
        link.disengage(reason)
    return request == "close"


def _tell(pipe: Connection, kind: str, value: Any) -> None:
    with contextlib.suppress(OSError):  # the tracker may be gone
        pipe.send((kind, value))
