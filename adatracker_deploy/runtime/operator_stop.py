"""The operator's ways to stop: signals, the Enter key, and a file descriptor for hooks.

A stop request is remembered until the command ends, even while a trial is already ending.
"""

from __future__ import annotations

import contextlib
import os
import select
import signal
import sys
import threading
from typing import TYPE_CHECKING

from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.runtime.lost_terminal import let_go

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
"""Ctrl-C, `adatracker-deploy stop`, and a lost terminal, as when SSH drops."""


class StopRequest:
    """Handles requests to stop this command, from any of `SIGNALS`, by raising KeyboardInterrupt.

    Within a trial only the first raises, and none while the trial ends: ending takes a bounded time and must
    not be cut short before the robot rests and the log is closed. All are remembered. An exception that gets
    lost on its way, as in a finalizer, is raised again by `insist`, which a trial calls at each of its turns.

    Args:
        on_first: called in the signal handler at the first request.
        outlives_terminal: a lost terminal does not stop the run.
    """

    def __init__(
        self, on_first: Callable[[], None] = lambda: None, *, outlives_terminal: bool = False
    ) -> None:
        self.asked = False
        """A stop has been requested."""
        self.outlives_terminal = outlives_terminal
        self._on_first = on_first
        self._in_trial = False
        self._only_remembers = False
        self._finishing = False
        self._terminals = tuple(number for number in (1, 2) if os.isatty(number))

    @contextlib.contextmanager
    def listening(self) -> Iterator[None]:
        """Install the signal handlers, in the main thread; an ignored SIGHUP, as under ``nohup``, stays
        ignored."""
        before = {number: signal.getsignal(number) for number in SIGNALS}
        for number, handler in before.items():
            if not (number is signal.SIGHUP and handler is signal.SIG_IGN):
                signal.signal(number, self._hear)
        try:
            yield
        finally:
            for number, handler in before.items():
                signal.signal(number, handler)

    @contextlib.contextmanager
    def trial(self) -> Iterator[None]:
        """Context in which one trial runs."""
        self._in_trial = True
        try:
            yield
        finally:
            self._in_trial = self._only_remembers = self._finishing = False

    def insist(self) -> None:
        """Raise KeyboardInterrupt if a stop was asked for in a trial that has not begun to end."""
        if self.asked and self._in_trial and not self._finishing:
            raise KeyboardInterrupt

    @contextlib.contextmanager
    def finishing(self) -> Iterator[None]:
        """From now on, until the trial has ended, only remember requests."""
        self._only_remembers = True  # first: what comes while the handlers are changed is remembered, too
        self._finishing = True
        try:
            with self.listening():
                yield
        finally:
            self._only_remembers = self._in_trial

    def _hear(self, number: int, _: object) -> None:
        let_go(self._terminals)
        if number == signal.SIGHUP and self.outlives_terminal:
            return
        if not self.asked:
            self.asked = True
            self._on_first()
        if not self._only_remembers:
            self._only_remembers = self._in_trial
            raise KeyboardInterrupt


@contextlib.contextmanager
def heard(stop_fd: int | None, *, outlives_terminal: bool = False, terminal: bool = True) -> Iterator[bool]:
    """Interrupt this process, as Ctrl-C does, on an operator's stop; yield whether Enter counts.

    Enter counts in a terminal, unless not `terminal`: its keys are read elsewhere then. `stop_fd` stops the
    run when anything can be read from it, or when its other end is closed: a hook that died stops the robot.
    So does a terminal that hangs up, unless `outlives_terminal`.

    Raises:
        UsageError: `stop_fd` is not open for reading.
    """
    watched = [] if stop_fd is None else [_readable(stop_fd)]
    typed = sys.stdin.fileno() if terminal and in_terminal() else None
    if typed is not None:
        watched.append(typed)
    if not watched:
        yield False
        return
    end, ender = os.pipe()
    spared = typed if outlives_terminal else None
    watcher = threading.Thread(target=_watch, args=(watched, end, spared), name="operator", daemon=True)
    watcher.start()
    try:
        yield typed is not None
    finally:
        os.close(ender)
        watcher.join()
        os.close(end)


def _readable(number: int) -> int:
    try:
        select.select([number], [], [], 0)
        os.read(number, 0)
    except (OSError, ValueError):
        raise UsageError(f"--stop-fd {number}: is not open for reading") from None
    return number


def in_terminal() -> bool:
    """Return whether this is a terminal's foreground job; a background job must not read the terminal."""
    if sys.stdin is None:
        return False
    try:
        return sys.stdin.isatty() and os.tcgetpgrp(sys.stdin.fileno()) == os.getpgrp()
    except (OSError, ValueError):
        return False


def _watch(watched: list[int], end: int, spared: int | None) -> None:
    """Interrupt this process when one of `watched` says so; `spared` may hang up."""
    while True:
        ready, _, _ = select.select([*watched, end], [], [])
        if end in ready:
            return
        if spared is not None and ready == [spared] and not os.isatty(spared):
            watched.remove(spared)
            continue
        for number in ready:
            if os.isatty(number):
                os.read(number, 4096)  # otherwise the shell would receive the line
        os.kill(os.getpid(), signal.SIGINT)
        return
