"""The operator's ways to stop besides Ctrl-C: the Enter key, and a file descriptor for hooks."""

from __future__ import annotations

import contextlib
import os
import select
import signal
import sys
import threading
from typing import TYPE_CHECKING

from adatracker_deploy.errors import UsageError

if TYPE_CHECKING:
    from collections.abc import Iterator


@contextlib.contextmanager
def heard(stop_fd: int | None) -> Iterator[bool]:
    """Interrupt this process, as Ctrl-C does, when the operator stops it; give whether Enter does.

    Enter does in a terminal. `stop_fd` stops when anything can be read from it, and when its other end is
    closed: a hook that died stops the robot.

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
    """Tell whether somebody sits before this process: a job in the background must not read the terminal."""
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
            os.read(number, 4096)  # else the shell would be given the line
    os.kill(os.getpid(), signal.SIGINT)
