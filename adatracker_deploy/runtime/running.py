"""Which trials run on this machine, so that `adatracker-deploy stop` finds them.

Each has a file of its own, named by its process, in a folder that is this user's alone. A file whose process
is gone, or is another one by now, says nothing. A process that was told to stop says there that it heard.
"""

from __future__ import annotations

import contextlib
import os
import stat
import tempfile
from dataclasses import dataclass
from pathlib import Path

from adatracker_deploy.errors import UsageError

_STOPPING = "stopping"
_BEGAN = 19
"""Place of a process's start time in what follows its name in /proc/PID/stat (proc(5), field 22)."""


@dataclass(frozen=True, slots=True)
class Running:
    """A process that drives a robot, or is about to."""

    pid: int
    began: str
    """Linux's clock ticks from boot to its start: tells it from a later process with its number."""
    what: str
    stopping: bool
    """It has heard that it shall stop."""

    def alive(self) -> bool:
        """Tell whether it still runs."""
        return _began(self.pid) == self.began


def folder() -> Path:
    """Return this user's folder, made if need be.

    Raises:
        UsageError: it is somebody else's.
    """
    runtime = os.environ.get("XDG_RUNTIME_DIR", "")  # named in some environments where there is none
    place = Path(runtime) if runtime and Path(runtime).is_dir() else Path(tempfile.gettempdir())
    path = place / f"adatracker-deploy-{os.getuid()}"
    with contextlib.suppress(FileExistsError):
        path.mkdir(mode=0o700)
    found = path.lstat()
    if not stat.S_ISDIR(found.st_mode) or found.st_uid != os.getuid() or found.st_mode & 0o077:
        raise UsageError(f"{path} is not a folder of this user alone: remove it")
    return path


class Announcement:
    """This process's own file."""

    def __init__(self, what: str) -> None:
        self._path = folder() / str(os.getpid())
        self._path.write_text(f"{_began(os.getpid())}\n{what}\n")

    def stopping(self) -> None:
        """Say that this process has heard that it shall stop."""
        with contextlib.suppress(OSError), self._path.open("a") as file:
            file.write(f"{_STOPPING}\n")

    def close(self) -> None:
        """Take it away."""
        self._path.unlink(missing_ok=True)


def running() -> tuple[Running, ...]:
    """Return what runs now, and forget what does not."""
    found = []
    for path in sorted(folder().iterdir()):
        with contextlib.suppress(OSError, ValueError):
            began, what, *said = path.read_text().splitlines()
            one = Running(int(path.name), began, what, _STOPPING in said)
            if one.alive():
                found.append(one)
            else:
                path.unlink()
    return tuple(found)


def _began(pid: int) -> str | None:
    """Return when a process began; None if there is none, or it only waits to be buried."""
    try:
        after_name = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return None
    return None if after_name[0] == "Z" else after_name[_BEGAN]
