"""``stop``: every trial that this user runs on this machine, from another terminal."""

from __future__ import annotations

import contextlib
import functools
import os
import signal
import time
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import argparse
    from collections.abc import Callable

    from adatracker_deploy.runtime.running import Running

ANSWER_S = 1.0
"""Within which a trial must say that it heard; else it is killed, and its link stops the robot."""
END_S = 120.0
"""For a drone to land and a log to be closed."""
POLL_S = 0.01


def add_parser(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the command."""
    parser = commands.add_parser(
        "stop",
        help="stop whatever runs on this machine",
        description="Stops every trial of this user as Ctrl-C does. One that does not answer is killed; its "
        "link then stops the robot. Exit status 1 if nothing ran.",
    )
    parser.set_defaults(run=lambda _: run())


def run() -> int:
    """Stop everything and wait until it has ended; return 1 if nothing ran, or would not end."""
    from adatracker_deploy.runtime.running import running

    found = running()
    if not found:
        print("nothing runs")
        return 1
    began_s = time.monotonic()
    for one in found:
        _tell(one, signal.SIGTERM)
    for one in found:
        name = f"{one.what} (process {one.pid})"
        if not _within(began_s + ANSWER_S, functools.partial(_heard, one)):
            _tell(one, signal.SIGKILL)
            print(f"{name} did not answer and was killed: its link stops the robot", flush=True)
        else:
            print(f"{name} stops", flush=True)
    ended = _within(began_s + END_S, lambda: not any(one.alive() for one in found))
    print(
        f"ended after {time.monotonic() - began_s:.1f} s" if ended else "still running: switch the robot off"
    )
    return 0 if ended else 1


def _heard(one: Running) -> bool:
    from adatracker_deploy.runtime.running import running

    return next((now.stopping for now in running() if now.pid == one.pid), True)


def _tell(one: Running, number: signal.Signals) -> None:
    if one.alive():
        with contextlib.suppress(ProcessLookupError):
            os.kill(one.pid, number)


def _within(end_s: float, condition: Callable[[], bool]) -> bool:
    while not condition():
        if time.monotonic() > end_s:
            return False
        time.sleep(POLL_S)
    return True
