"""Keeps the machine from going to sleep while it drives a robot, by systemd's inhibitor where there is one.

A sleep that comes all the same, of an empty battery say, is noticed by the link (`clock.suspended_ns`).
"""

from __future__ import annotations

import contextlib
import select
import subprocess
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterator

ANSWER_S = 2.0
_KINDS = ("sleep:idle:handle-lid-switch", "sleep:idle")
"""What is asked for, the second where the first is refused; logind lets a closed lid pass a lock on sleep."""
_HELD = "echo held; exec cat"
"""Runs under the lock until its input ends, which is when this process does, whatever ends it."""


@contextlib.contextmanager
def inhibited(why: str) -> Iterator[str]:
    """Hold the lock in here; give what it covers, as systemd-inhibit(1) names it, empty where there is none.

    Args:
        why: shown to who asks the machine to sleep.
    """
    for kinds in _KINDS:
        holder = _hold(kinds, why)
        if holder is not None:
            break
    else:
        yield ""
        return
    try:
        yield kinds
    finally:
        holder.communicate()


def _hold(kinds: str, why: str) -> subprocess.Popen[bytes] | None:
    """Return the process that holds a lock; None where that is refused, or there is no systemd."""
    try:
        holder = subprocess.Popen(
            [
                *("systemd-inhibit", f"--what={kinds}", "--who=adatracker-deploy", f"--why={why}"),
                *("--mode=block", "sh", "-c", _HELD),
            ],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            start_new_session=True,  # a Ctrl-C in the terminal must not let the machine sleep
        )
    except OSError:
        return None
    assert holder.stdout is not None
    if select.select([holder.stdout], [], [], ANSWER_S)[0] and holder.stdout.readline() == b"held\n":
        return holder
    holder.kill()
    holder.communicate()
    return None
