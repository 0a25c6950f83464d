"""``stop``: the trials that run on this machine, from another terminal."""

from __future__ import annotations

import contextlib
import functools
import os
import pwd
import signal
import time
from typing import TYPE_CHECKING

from adatracker_deploy.core.errors import UsageError

if TYPE_CHECKING:
    import argparse
    from collections.abc import Callable, Sequence

    from adatracker_deploy.runtime.running import Running

ANSWER_S = 1.0
"""Time within which a trial must acknowledge; otherwise it is killed, and its link stops the robot."""
END_S = 120.0
"""Time for a drone to land and a log to be closed."""
POLL_S = 0.01


def add_parser(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the command."""
    parser = commands.add_parser(
        "stop",
        help="stop trials that run on this machine",
        description="Stops trials as Ctrl-C does: all of this user's (for root, everybody's), or those that "
        "are named. One that does not answer is killed; its link then stops the robot. One that is stopping "
        "already is waited for. Exit status 1 if nothing ran, or a trial could not be stopped.",
    )
    parser.add_argument(
        "which",
        nargs="*",
        metavar="TRIAL|PLATFORM",
        help="a trial's log folder or its name, a platform, or a process's number (default: every trial)",
    )
    parser.set_defaults(run=lambda args: run(args.which))


def run(which: Sequence[str] = ()) -> int:
    """Stop trials and wait until they have ended; return 1 if there was none, or one would not end.

    Raises:
        UsageError: a name fits no trial that runs; nothing was stopped.
    """
    from adatracker_deploy.runtime.running import running

    found = running()
    for name in which:
        if not any(one.is_meant(name) for one in found):
            raise UsageError(f"stop {name}: no such trial runs; {_list(found) or 'nothing runs'}")
    meant = [one for one in found if not which or any(map(one.is_meant, which))]
    mine = [one for one in meant if os.getuid() in (0, one.user)]
    for one in meant:
        if one not in mine:
            print(f"{_name(one)} is another user's: stop it as {_user(one.user)}, or with sudo", flush=True)
    if not mine:
        if not meant:
            print("nothing runs")
        return 1
    began_s = time.monotonic()
    for one in mine:
        _tell(one, signal.SIGTERM)
    for one in mine:
        if not _within(began_s + ANSWER_S, functools.partial(_heard, one)):
            _tell(one, signal.SIGKILL)
            print(f"{_name(one)} did not answer and was killed: its link stops the robot", flush=True)
        else:
            print(f"{_name(one)} stops", flush=True)
    ended = _within(began_s + END_S, lambda: not any(one.alive() for one in mine))
    print(
        f"ended after {time.monotonic() - began_s:.1f} s" if ended else "still running: switch the robot off"
    )
    return 0 if ended and mine == meant else 1


def _list(found: Sequence[Running]) -> str:
    """Name the trials that run, in one line."""
    return ", ".join(f"{_name(one)}{f' in {one.log}' if one.log else ''}" for one in found)


def _name(one: Running) -> str:
    return f"{one.platforms} (process {one.pid})"


def _user(number: int) -> str:
    try:
        return pwd.getpwuid(number).pw_name
    except KeyError:
        return f"user {number}"


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
