"""``stop``: the trials that run on this machine, from another terminal."""

from __future__ import annotations

import functools
import os
import pwd
import signal
import time
from typing import TYPE_CHECKING

from adatracker_deploy.core.errors import UsageError

if TYPE_CHECKING:
    import argparse
    from collections.abc import Sequence

    from adatracker_deploy.runtime.running import Running


def add_parser(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the command."""
    parser = commands.add_parser(
        "stop",
        help="stop trials that run on this machine",
        description="Stop trials as Ctrl-C does: all of this user's (for root, everybody's), or those that "
        "are named. A trial that does not answer is killed; its link then stops the robot. A trial that is "
        "already stopping is waited for. Exit status 1 if nothing ran, or a trial could not be stopped.",
    )
    parser.add_argument(
        "which",
        nargs="*",
        metavar="TRIAL|NAME|PLATFORM",
        help="a trial's log folder or its name, a robot's --name, a platform, 'fleet', or a process's number "
        "(default: every trial)",
    )
    parser.set_defaults(run=lambda args: run(args.which))


def run(which: Sequence[str] = ()) -> int:
    """Stop trials and wait until they have ended; return 1 if there was none, or one would not end.

    Raises:
        UsageError: a name fits no trial that runs; nothing was stopped.
    """
    from adatracker_deploy.runtime.running import running
    from adatracker_deploy.runtime.stopping import ANSWER_S, END_S, acknowledged, within

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
        if not within(began_s + ANSWER_S, functools.partial(acknowledged, one.pid)):
            _tell(one, signal.SIGKILL)
            print(f"{_name(one)} did not answer and was killed: its link stops the robot", flush=True)
        else:
            print(f"{_name(one)} stops", flush=True)
    ended = within(began_s + END_S, lambda: not any(one.alive() for one in mine))
    print(
        f"ended after {time.monotonic() - began_s:.1f} s" if ended else "still running: switch the robot off"
    )
    return 0 if ended and mine == meant else 1


def _list(found: Sequence[Running]) -> str:
    """Name the trials that run, in one line."""
    return ", ".join(f"{_name(one)}{f' in {one.log}' if one.log else ''}" for one in found)


def _name(one: Running) -> str:
    return f"{one.name or one.platforms} (process {one.pid})"


def _user(number: int) -> str:
    try:
        return pwd.getpwuid(number).pw_name
    except KeyError:
        return f"user {number}"


def _tell(one: Running, number: signal.Signals) -> None:
    from adatracker_deploy.runtime.stopping import tell

    if one.alive():
        tell(one.pid, number)
