"""Prevents system sleep while driving a robot, with systemd's inhibitor where available.

If the machine sleeps anyway, as on an empty battery, the link notices (`clock.suspended_ns`).
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
"""Locks to request, the second if the first is refused; a closed lid overrides logind's sleep lock."""
_HELD = "echo held; exec cat"
"""Runs under the lock until its input ends, which is when this process ends, however it does."""


@contextlib.contextmanager
def inhibited(why: str) -> Iterator[str]:
    """Hold the lock; yield what it covers, by the names of systemd-inhibit(1), or an empty string without
    one.

    Args:
        why: shown to anybody who tries to suspend the machine.
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
    """Return the process that holds a lock; None if refused, or without systemd."""
    try:
        holder = subprocess.Popen(
            [
                *("systemd-inhibit", f"--what={kinds}", "--who=adatracker-deploy", f"--why={why}"),
                *("--mode=block", "sh", "-c", _HELD),
            ],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            start_new_session=True,  # a Ctrl-C in the terminal must not end the lock
        )
    except OSError:
        return None
    assert holder.stdout is not None
    if select.select([holder.stdout], [], [], ANSWER_S)[0] and holder.stdout.readline() == b"held\n":
        return holder
    holder.kill()
    holder.communicate()
    return None
