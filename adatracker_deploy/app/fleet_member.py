"""One robot of a fleet, as the fleet's command has it: a run of its own, in a process of its own."""

from __future__ import annotations

import contextlib
import json
import os
import subprocess
import sys
from typing import TYPE_CHECKING, Any

from adatracker_deploy.app.fleet_steps import Standing
from adatracker_deploy.runtime.service_watchdog import PERIOD_VARIABLE, SOCKET_VARIABLE
from adatracker_deploy.runtime.start_line import StartLineKeeper
from adatracker_deploy.runtime.stopping import acknowledged

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from pathlib import Path

COMMAND = (sys.executable, "-m", "adatracker_deploy")
OUTPUT_NAME, RESULT_NAME = "output.txt", "result.json"
_ERROR = "adatracker-deploy: "
_COLUMNS = "200"
"""Width for which a run writes its lines; the fleet's terminal folds them."""


class Member:
    """A robot's run.

    What it says goes into files in its log folder: a pipe that nobody reads, because the fleet's command
    hangs, would hold up its loop. It stays in this process group, so that Ctrl-C and Ctrl-Z in a terminal
    reach it whatever this command does.

    Args:
        name: the robot's.
        arguments: its command line.
        folder: for its logs; created here.
        stop_fd: the read end of a pipe; the run stops when the pipe closes.
    """

    def __init__(self, name: str, arguments: Sequence[str], folder: Path, stop_fd: int) -> None:
        self.name = name
        self.folder = folder
        folder.mkdir(mode=0o700)
        self._keeper = StartLineKeeper()
        theirs = self._keeper.theirs
        of_the_fleet = (
            *("--name", name, "--log-dir", str(folder), "--json", "--no-ask"),
            *("--stop-fd", str(stop_fd), "--together", str(theirs.fileno())),
        )
        with theirs, (folder / RESULT_NAME).open("wb") as out, (folder / OUTPUT_NAME).open("wb") as said:
            self._process = subprocess.Popen(
                [*COMMAND, *arguments, *of_the_fleet],
                stdin=subprocess.DEVNULL,
                stdout=out,
                stderr=said,
                pass_fds=(stop_fd, theirs.fileno()),
                env=_environment(),
            )
        self._said = (folder / OUTPUT_NAME).open("rb")
        self._rest = b""
        self._under_way = False
        """It opens what it needs, and so hears the closing pipe."""

    @property
    def pid(self) -> int:
        """Its process."""
        return self._process.pid

    def standing(self) -> Standing:
        """Return how far it is."""
        status = self._process.poll()
        return Standing(self.name, self._keeper.reached(), status)

    def release(self) -> None:
        """Let it go on to the next stage of the start."""
        self._under_way = True
        self._keeper.release()

    def news(self) -> Iterator[str]:
        """Give the lines that it has said since the last call; without its end, no half ones."""
        ended = self._process.poll() is not None
        *lines, self._rest = (self._rest + self._said.read()).split(b"\n")
        if ended and self._rest:
            lines, self._rest = [*lines, self._rest], b""
        yield from (line.decode(errors="replace").rstrip() for line in lines)

    def turn_back(self) -> None:
        """Stop it while it checks its request: it does not hear the closing pipe yet."""
        if not self._under_way:
            self._process.terminate()

    def has_heard(self) -> bool:
        """Return whether it has acknowledged a stop, or has ended."""
        return self._process.poll() is not None or acknowledged(self.pid)

    def kill(self) -> None:
        """End a run that does not answer; its link brings the robot to rest."""
        self._process.kill()

    def refusal(self) -> str:
        """Return why its request was refused, as it said itself."""
        lines = (self.folder / OUTPUT_NAME).read_text(errors="replace").splitlines()
        return next((line.removeprefix(_ERROR) for line in reversed(lines) if line.startswith(_ERROR)), "")

    def result(self) -> dict[str, Any] | None:
        """Return what it printed with ``--json``; None where it did not come to that."""
        with contextlib.suppress(ValueError, IndexError):
            found: dict[str, Any] = json.loads((self.folder / RESULT_NAME).read_text().splitlines()[-1])
            return found
        return None

    def wait(self) -> int:
        """Wait for its end; return its exit status, negative for the signal that killed it."""
        return self._process.wait()

    def close(self) -> None:
        """Wait for its end, and let go of its files; may be called twice."""
        self._keeper.close()
        self._process.wait()
        self._said.close()

    def forget(self) -> None:
        """Remove the folder of a run that was refused; one with more in it than was said stays."""
        for name in (OUTPUT_NAME, RESULT_NAME):
            (self.folder / name).unlink(missing_ok=True)
        with contextlib.suppress(OSError):
            self.folder.rmdir()


def _environment() -> dict[str, str]:
    """Return a run's environment: no link of several feeds, or rests, a watchdog of the whole unit."""
    units = (SOCKET_VARIABLE, PERIOD_VARIABLE)
    return {name: value for name, value in os.environ.items() if name not in units} | {"COLUMNS": _COLUMNS}
