"""Who was in charge of a robot and never gave it back: a mark that outlives the process that made it.

A robot that is found enabled belongs to somebody. This user's own run that was killed leaves its mark, and
then a later run may take the robot back; anybody else's robot is left to them.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
from pathlib import Path

from adatracker_deploy.runtime.running import folder


class ChargeMark:
    """The mark of one robot, in this user's folder.

    Args:
        robot: names the robot's wire, as for `ownership.Claim`; whoever asks must hold that claim.

    Raises:
        UsageError: the folder is somebody else's.
    """

    def __init__(self, robot: str) -> None:
        self._path = folder() / f"charge-{hashlib.sha256(robot.encode()).hexdigest()[:16]}"

    def set(self) -> None:
        """Say that this process is in charge; without a disk to say it on it is in charge all the same."""
        with contextlib.suppress(OSError):
            self._path.write_text(f"{os.getpid()}\n")

    def clear(self) -> None:
        """Say that nobody is: the robot was given back, or somebody else has taken it."""
        with contextlib.suppress(OSError):
            self._path.unlink(missing_ok=True)

    def left_by(self) -> int | None:
        """Return the process that was in charge and has ended, or is this one; None if there is none."""
        try:
            pid = int(self._path.read_text())
        except (OSError, ValueError):
            return None
        return pid if pid == os.getpid() or not Path(f"/proc/{pid}").exists() else None
