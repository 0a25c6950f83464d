"""A simulator that outlives its runs: a second run finds the robot as the first left it.

The fault matrix starts it (`serving`) and passes its address to a run in a file; the run uses it
(`RunningSimulator`) as if it had started it, including its faults.
"""

from __future__ import annotations

import contextlib
import dataclasses
import json
import os
import threading
from pathlib import Path
from typing import TYPE_CHECKING

from adatracker_deploy.config.schema import parse
from adatracker_deploy.core.clock import MonotonicClock
from adatracker_deploy.platform import Sitl

if TYPE_CHECKING:
    from collections.abc import Iterator

    from adatracker_deploy.config.profile import Profile
    from adatracker_deploy.core.clock import Clock
    from adatracker_deploy.platform import Platform, Scenario

_FILE, _ORDERS, _WITNESS = "simulator.json", "orders", "witness.txt"


@contextlib.contextmanager
def serving(
    platform: type[Platform], profile: Profile, scenario: Scenario, folder: Path
) -> Iterator[tuple[Path, Path]]:
    """Start a simulator; yield the file for ``--simulator`` and the ground-truth file.

    Args:
        platform: the robot.
        profile: the robot's.
        scenario: the world around it.
        folder: for the files.

    Raises:
        UsageError, PlatformError: as `Sitl.start`.
    """
    orders, witness, file = (folder / name for name in (_ORDERS, _WITNESS, _FILE))
    os.mkfifo(orders, 0o600)
    with platform.sitl(profile) as sitl:
        reached = sitl.start(MonotonicClock(), scenario)
        sitl.order(f"witness {witness.resolve()}")
        file.write_text(
            json.dumps(
                {
                    "connection": dataclasses.asdict(reached.connection),
                    "camera": reached.camera.uri,
                    "orders": str(orders),
                    "witness": str(witness),
                }
            ),
            encoding="utf-8",
        )
        # Open for reading and writing, so that it does not end with each run.
        with os.fdopen(os.open(orders, os.O_RDWR), encoding="utf-8", closefd=True) as lines:
            passing = threading.Thread(target=_pass_on, args=(lines, sitl), name="orders", daemon=True)
            passing.start()
            try:
                yield file, witness
            finally:
                _write(orders, "")
                passing.join()


class RunningSimulator(Sitl):
    """A handle, in a run, on a simulator that is already running.

    Args:
        file: written by `serving`.
        platform: its robot.
        profile: the robot's.
    """

    def __init__(self, file: Path, platform: type[Platform], profile: Profile) -> None:
        said = json.loads(file.read_text(encoding="utf-8"))
        self._profile = dataclasses.replace(
            profile,
            connection=parse(platform.Connection, said["connection"], where="connection"),
            camera=dataclasses.replace(profile.camera, uri=said["camera"]),
        )
        self._orders = Path(said["orders"])
        self.faults = platform.sitl(profile).faults
        self.witness = Path(said["witness"])

    def start(self, clock: Clock, scenario: Scenario) -> Profile:  # noqa: ARG002 -- it runs already
        """Return the profile with its connection."""
        return self._profile

    def close(self) -> None:
        """Leave it running; whoever started it ends it."""

    def order(self, line: str) -> None:
        """Forward a command to it."""
        _write(self._orders, line)


def _write(orders: Path, line: str) -> None:
    with orders.open("w", encoding="utf-8") as pipe:
        pipe.write(f"{line}\n")


def _pass_on(lines: Iterator[str], sitl: Sitl) -> None:
    """Forward each line until an empty one comes."""
    for line in lines:
        if not line.strip():
            return
        sitl.order(line.strip())
