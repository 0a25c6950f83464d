"""Which trials run on this machine, so that `adatracker-deploy stop` finds them.

Each has a file of its own, named by its process, in one folder for each user: in /dev/shm, which all sessions
of a machine share whatever their environment says, and which a reboot empties. A file whose process is gone,
or is another one by now, says nothing. A process that was told to stop says there that it heard.
"""

from __future__ import annotations

import contextlib
import os
import stat
import tempfile
from dataclasses import dataclass
from pathlib import Path

from adatracker_deploy.core.errors import UsageError

PLACE_VARIABLE = "ADATRACKER_RUN_DIR"
"""Environment variable that names another place; trials there are found only by those who name it, too."""
_STOPPING = "stopping"
_LOGGING = "log "
_BEGAN = 19
"""Place of a process's start time in what follows its name in /proc/PID/stat (proc(5), field 22)."""
_FOLDER = "adatracker-deploy-"


@dataclass(frozen=True, slots=True)
class Running:
    """A process that drives a robot, or is about to."""

    pid: int
    began: str
    """Linux's clock ticks from boot to its start: tells it from a later process with its number."""
    platforms: str
    """As ``--platform`` was given: a name, or several with commas between them."""
    stopping: bool
    """It has heard that it shall stop."""
    user: int
    """Whose process it is."""
    log: str = ""
    """The folder of its trial's log; empty before there is one."""

    def alive(self) -> bool:
        """Tell whether it still runs."""
        return _began(self.pid) == self.began

    def is_meant(self, selector: str) -> bool:
        """Tell whether this is named: by platform, process number, or log folder (whole or its name)."""
        known = {str(self.pid), *self.platforms.split(",")}
        if self.log:
            known |= {self.log, Path(self.log).name, str(Path(self.log).resolve())}
        return selector in known or str(Path(selector).resolve()) in known


def folder() -> Path:
    """Return this user's folder, made if need be; others can read it, and nobody else can write it.

    Raises:
        UsageError: it is somebody else's.
    """
    path = _place() / f"{_FOLDER}{os.getuid()}"
    with contextlib.suppress(FileExistsError):
        path.mkdir(mode=0o755)
    if not _is_sound(path, os.getuid()):
        raise UsageError(f"{path} is not a folder that this user alone can write: remove it")
    return path


class Announcement:
    """This process's own file."""

    def __init__(self, platforms: str) -> None:
        self._path = folder() / str(os.getpid())
        self._path.write_text(f"{_began(os.getpid())}\n{platforms}\n")

    def logging(self, log: Path) -> None:
        """Say which folder the log of the trial that now runs is in."""
        self._say(f"{_LOGGING}{log.absolute()}")

    def stopping(self) -> None:
        """Say that this process has heard that it shall stop."""
        self._say(_STOPPING)

    def close(self) -> None:
        """Take it away."""
        self._path.unlink(missing_ok=True)

    def _say(self, line: str) -> None:
        with contextlib.suppress(OSError), self._path.open("a") as file:
            file.write(f"{line}\n")


def running() -> tuple[Running, ...]:
    """Return what runs now, this user's first, then other users'; forget what does not run."""
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
            logs = [line.removeprefix(_LOGGING) for line in said if line.startswith(_LOGGING)]
            one = Running(
                pid=int(path.name),
                began=began,
                platforms=platforms,
                stopping=_STOPPING in said,
                user=int(user),
                log=logs[-1] if logs else "",
            )
            # A file may name any process: only one of the file's own user is believed to be meant.
            if one.alive() and Path(f"/proc/{one.pid}").stat().st_uid == one.user:
                found.append(one)
            elif one.user == os.getuid():
                path.unlink()
    return found


def _place() -> Path:
    if named := os.environ.get(PLACE_VARIABLE, ""):
        return Path(named)
    shared = Path("/dev/shm")
    return shared if shared.is_dir() and os.access(shared, os.W_OK) else Path(tempfile.gettempdir())


def _is_sound(path: Path, user: int) -> bool:
    """Tell whether a folder belongs to a user and nobody else can write it."""
    try:
        found = path.lstat()
    except OSError:
        return False
    return stat.S_ISDIR(found.st_mode) and found.st_uid == user and not found.st_mode & 0o022


def _began(pid: int) -> str | None:
    """Return when a process began; None if there is none, or it only waits to be buried."""
    try:
        after_name = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return None
    return None if after_name[0] == "Z" else after_name[_BEGAN]
