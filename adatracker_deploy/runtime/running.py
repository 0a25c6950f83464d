"""Registry of the trials running on this machine, for `adatracker-deploy stop`.

Each trial has a file named by its process, in a folder per user in /dev/shm: all sessions share it, whatever
their environment, and a reboot empties it. A file is ignored if its process is gone or its number was reused.
A process that was told to stop acknowledges it in its file.
"""

from __future__ import annotations

import contextlib
import os
import stat
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from adatracker_deploy.core.errors import UsageError

if TYPE_CHECKING:
    from collections.abc import Sequence

PLACE_VARIABLE = "ADATRACKER_RUN_DIR"
"""Environment variable that names another folder; trials there are found only with the same setting."""
_STOPPING = "stopping"
_LOGGING = "log "
_NAMED = "name "
_BEGAN = 19
"""Index of the start time among the fields after the name in /proc/PID/stat (proc(5), field 22)."""
_FOLDER = "adatracker-deploy-"


@dataclass(frozen=True, slots=True)
class Running:
    """A process that drives a robot or is about to."""

    pid: int
    began: str
    """Its start, in Linux clock ticks from boot: distinguishes it from a later process with the same
    number."""
    platforms: str
    """The ``--platform`` argument: one name, or several separated by commas."""
    stopping: bool
    """It has acknowledged a stop request."""
    user: int
    """The user who owns the process."""
    log: str = ""
    """Its trial's log folder; empty before there is one."""
    name: str = ""
    """The ``--name`` argument; empty without one."""

    def alive(self) -> bool:
        """Return whether it still runs."""
        return _began(self.pid) == self.began

    def is_meant(self, selector: str) -> bool:
        """Return whether this trial is meant: by name, platform, process, or log folder (path or name)."""
        known = {str(self.pid), *self.platforms.split(",")} | ({self.name} if self.name else set())
        if self.log:
            known |= {self.log, Path(self.log).name, str(Path(self.log).resolve())}
        return selector in known or str(Path(selector).resolve()) in known


def folder() -> Path:
    """Return this user's folder, created if needed; others can read it but not write it.

    Raises:
        UsageError: it belongs to somebody else.
    """
    path = _place() / f"{_FOLDER}{os.getuid()}"
    with contextlib.suppress(FileExistsError):
        path.mkdir(mode=0o755)
    if not _is_sound(path, os.getuid()):
        raise UsageError(f"{path} is not a folder that this user alone can write: remove it")
    return path


class Announcement:
    """This process's own file."""

    def __init__(self, platforms: str, name: str = "") -> None:
        self._path = folder() / str(os.getpid())
        self._path.write_text(f"{_began(os.getpid())}\n{platforms}\n")
        if name:
            self._say(f"{_NAMED}{name}")

    def logging(self, log: Path) -> None:
        """Announce the current trial's log folder."""
        self._say(f"{_LOGGING}{log.absolute()}")

    def stopping(self) -> None:
        """Acknowledge a stop request."""
        self._say(_STOPPING)

    def close(self) -> None:
        """Remove the file."""
        self._path.unlink(missing_ok=True)

    def _say(self, line: str) -> None:
        with contextlib.suppress(OSError), self._path.open("a") as file:
            file.write(f"{line}\n")


def running() -> tuple[Running, ...]:
    """Return the running trials, this user's first; remove stale files."""
    mine = folder()
    others = (path for path in sorted(_place().glob(f"{_FOLDER}*")) if path != mine)
    return tuple(one for place in (mine, *others) for one in _running_in(place))


def _running_in(place: Path) -> list[Running]:
    found: list[Running] = []
    user = place.name.removeprefix(_FOLDER)
    if not user.isdecimal() or not _is_sound(place, int(user)):
        return found
    for path in sorted(place.iterdir()):
        with contextlib.suppress(OSError, ValueError):
            began, platforms, *said = path.read_text().splitlines()
            logs, names = _said(said, _LOGGING), _said(said, _NAMED)
            one = Running(
                pid=int(path.name),
                began=began,
                platforms=platforms,
                stopping=_STOPPING in said,
                user=int(user),
                log=logs[-1] if logs else "",
                name=names[-1] if names else "",
            )
            # A file may name any process; believe it only if the process belongs to the file's user.
            if one.alive() and Path(f"/proc/{one.pid}").stat().st_uid == one.user:
                found.append(one)
            elif one.user == os.getuid():
                path.unlink()
    return found


def _said(lines: Sequence[str], what: str) -> list[str]:
    return [line.removeprefix(what) for line in lines if line.startswith(what)]


def _place() -> Path:
    if named := os.environ.get(PLACE_VARIABLE, ""):
        return Path(named)
    shared = Path("/dev/shm")
    return shared if shared.is_dir() and os.access(shared, os.W_OK) else Path(tempfile.gettempdir())


def _is_sound(path: Path, user: int) -> bool:
    """Return whether a folder belongs to a user and nobody else can write it."""
    try:
        found = path.lstat()
    except OSError:
        return False
    return stat.S_ISDIR(found.st_mode) and found.st_uid == user and not found.st_mode & 0o022


def _began(pid: int) -> str | None:
    """Return when a process began; None if there is none, or it is a zombie."""
    try:
        after_name = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return None
    return None if after_name[0] == "Z" else after_name[_BEGAN]
