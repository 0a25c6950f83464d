"""A mark that outlives its process: who was in control of a robot and never released it.

A robot found enabled belongs to somebody. If this user's own run was killed, its mark remains, and a later
run may take the robot back; anybody else's robot is left alone.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
from pathlib import Path

from adatracker_deploy.runtime.running import folder


class ChargeMark:
    """One robot's mark, in this user's folder.

    Args:
        robot: names the robot's connection, as for `ownership.Claim`; the caller must hold that claim.

    Raises:
        UsageError: the folder belongs to somebody else.
    """

    def __init__(self, robot: str) -> None:
        self._path = folder() / f"charge-{hashlib.sha256(robot.encode()).hexdigest()[:16]}"

    def set(self) -> None:
        """Mark this process as in control; a failed write is ignored."""
        with contextlib.suppress(OSError):
            self._path.write_text(f"{os.getpid()}\n")

    def clear(self) -> None:
        """Clear the mark: the robot was released, or somebody else has taken it."""
        with contextlib.suppress(OSError):
            self._path.unlink(missing_ok=True)

    def left_by(self) -> int | None:
        """Return the process that was in control, if it has ended or is this one; else None."""
        try:
            pid = int(self._path.read_text())
        except (OSError, ValueError):
            return None
        return pid if pid == os.getpid() or not Path(f"/proc/{pid}").exists() else None
