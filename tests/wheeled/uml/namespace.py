"""Run a command beside a ``vcan0`` of this machine's own kernel, in namespaces made for it.

A user namespace (unshare(1)) gives the rights to make interfaces and to take them down, a network namespace
keeps them from the machine's own, and a process namespace ends everything with the command. It needs no root.
"""

from __future__ import annotations

import subprocess
import sys
from typing import TYPE_CHECKING

from tests.wheeled.uml.interfaces import add_vcan, set_up
from tests.wheeled.uml.room import ROOT, TIMED_OUT, Ended

if TYPE_CHECKING:
    from collections.abc import Sequence

UNSHARE = ("unshare", "--user", "--map-root-user", "--net", "--pid", "--fork", "--mount-proc", "--kill-child")
NOT_FOUND = 127
"""Exit status of a command that there is not, as a shell has it."""


def run(command: Sequence[str], *, limit_s: float) -> Ended:
    """Run `command` as root of namespaces in which ``vcan0`` and ``lo`` are up; leaves nothing behind."""
    try:
        done = subprocess.run(
            [*UNSHARE, sys.executable, "-m", "tests.wheeled.uml.namespace", *command],
            cwd=ROOT,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            timeout=limit_s,
            check=False,
        )
    except subprocess.TimeoutExpired as error:
        return Ended(TIMED_OUT, (error.stdout or b"").decode(errors="replace"))
    except FileNotFoundError:
        return Ended(NOT_FOUND, "unshare is not installed")
    return Ended(done.returncode, done.stdout.decode(errors="replace"))


def main(command: list[str]) -> int:
    """From inside the namespaces: make ``vcan0``, run the command, return its status as a shell does."""
    try:
        add_vcan("vcan0")
        set_up("vcan0")
        set_up("lo")
    except OSError as error:
        print(f"no vcan0: {error.strerror}")
        return 1
    code = subprocess.call(command)
    return code if code >= 0 else 128 - code


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
