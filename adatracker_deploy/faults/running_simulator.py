"""A simulator that outlives its runs: a second run meets the robot as the first one left it.

The fault matrix starts it (`serving`) and tells a run by a file how to reach it; the run takes it in a
simulator 's place (`RunningFarEnd`), with the faults of one.
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
    """Start a simulator; give the file for ``--simulator`` and the one that its witness writes.

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
        # Open for both, so that it does not end whenever a run does.
        with os.fdopen(os.open(orders, os.O_RDWR), encoding="utf-8", closefd=True) as lines:
            passing = threading.Thread(target=_pass_on, args=(lines, sitl), name="orders", daemon=True)
            passing.start()
            try:
                yield file, witness
            finally:
                _write(orders, "")
                passing.join()


class RunningFarEnd(Sitl):
    """Stands in a simulator's place in the run that is pointed to it.

    Args:
        file: which `serving` wrote.
        platform: the robot that it is of.
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
        """Return the profile that reaches it."""
        return self._profile

    def close(self) -> None:
        """Leave it to whoever started it."""

    def order(self, line: str) -> None:
        """Pass an order on to it."""
        _write(self._orders, line)


def _write(orders: Path, line: str) -> None:
    with orders.open("w", encoding="utf-8") as pipe:
        pipe.write(f"{line}\n")


def _pass_on(lines: Iterator[str], sitl: Sitl) -> None:
    """Pass each line on until an empty one comes."""
    for line in lines:
        if not line.strip():
            return
        sitl.order(line.strip())
