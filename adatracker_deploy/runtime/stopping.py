"""Stops a trial that runs in another process: asks it, and kills it if it does not answer."""

from __future__ import annotations

import contextlib
import os
import signal
import time
from typing import TYPE_CHECKING

from adatracker_deploy.runtime.running import running

if TYPE_CHECKING:
    from collections.abc import Callable

ANSWER_S = 1.0
"""Time within which a trial must acknowledge; otherwise it is killed, and its link stops the robot."""
END_S = 120.0
"""Time for a drone to land and a log to be closed."""
_POLL_S = 0.01


def stop(pid: int) -> bool:
    """Stop one trial; return whether it acknowledged. One that did not was killed."""
    tell(pid, signal.SIGTERM)
    if within(time.monotonic() + ANSWER_S, lambda: acknowledged(pid)):
        return True
    tell(pid, signal.SIGKILL)
    return False


def tell(pid: int, number: signal.Signals) -> None:
    """Send a process a signal, if it is there."""
    with contextlib.suppress(ProcessLookupError):
        os.kill(pid, number)


def acknowledged(pid: int) -> bool:
    """Return whether a trial has acknowledged a stop, has ended, or was never announced."""
    return next((one.stopping for one in running() if one.pid == pid), True)


def within(end_s: float, condition: Callable[[], bool]) -> bool:
    """Wait for a condition until a time of `time.monotonic`; return whether it was met."""
    while not condition():
        if time.monotonic() > end_s:
            return False
        time.sleep(_POLL_S)
    return True
