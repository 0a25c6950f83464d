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

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
"""Ctrl-C, `adatracker-deploy stop`, and a lost terminal, as when SSH drops."""


class StopRequest:
    """Handles requests to stop this command, from any of `SIGNALS`, by raising KeyboardInterrupt.

    Within a trial only the first raises, and none while the trial ends: ending takes a bounded time and must
    not be cut short before the robot rests and the log is closed. All are remembered.

    Args:
        on_first: called in the signal handler at the first request.
    """

    def __init__(self, on_first: Callable[[], None] = lambda: None) -> None:
        self.asked = False
        """A stop has been requested."""
        self._on_first = on_first
        self._in_trial = False
        self._only_remembers = False
        self._terminals = [number for number in (1, 2) if os.isatty(number)]

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
            self._in_trial = self._only_remembers = False

    @contextlib.contextmanager
    def finishing(self) -> Iterator[None]:
        """From now on, until the trial has ended, only remember requests."""
        self._only_remembers = True  # first: what comes while the handlers are changed is remembered, too
        try:
            with self.listening():
                yield
        finally:
            self._only_remembers = self._in_trial

    def _hear(self, *_: object) -> None:
        self._let_go_of_lost_terminals()
        if not self.asked:
            self.asked = True
            self._on_first()
        if not self._only_remembers:
            self._only_remembers = self._in_trial
            raise KeyboardInterrupt

    def _let_go_of_lost_terminals(self) -> None:
        """Redirect output to nowhere: with a lost terminal every line would be an error."""
        for number in self._terminals:
            if not os.isatty(number):
                nowhere = os.open(os.devnull, os.O_WRONLY)
                os.dup2(nowhere, number)
                os.close(nowhere)


@contextlib.contextmanager
def heard(stop_fd: int | None) -> Iterator[bool]:
    """Interrupt this process, as Ctrl-C does, on an operator's stop; yield whether Enter counts.

    Enter counts in a terminal. `stop_fd` stops the run when anything can be read from it, or when its other
    end is closed: a hook that died stops the robot.

    Raises:
        UsageError: `stop_fd` is not open for reading.
    """
    watched = [] if stop_fd is None else [_readable(stop_fd)]
    terminal = sys.stdin.fileno() if in_terminal() else None
    if terminal is not None:
        watched.append(terminal)
    if not watched:
        yield False
        return
    end, ender = os.pipe()
    watcher = threading.Thread(target=_watch, args=(watched, end), name="operator", daemon=True)
    watcher.start()
    try:
        yield terminal is not None
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


def _watch(watched: list[int], end: int) -> None:
    ready, _, _ = select.select([*watched, end], [], [])
    if end in ready:
        return
    for number in ready:
        if os.isatty(number):
            os.read(number, 4096)  # otherwise the shell would receive the line
    os.kill(os.getpid(), signal.SIGINT)
