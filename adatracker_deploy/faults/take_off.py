"""Detects when a drone is armed and when it climbs, from its ground-truth record."""

from __future__ import annotations

import threading
from typing import TYPE_CHECKING

from adatracker_deploy.faults.phases import TrialPhase
from adatracker_deploy.sim.ground_truth import Account, read_witness

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

CLIMBING_M = 0.5
"""Above this height a drone is climbing, whatever its landing gear and the wind do."""
LOOK_S = 0.01


def reached(account: Account) -> tuple[TrialPhase, ...]:
    """Return the phases of a take-off that a robot has reached, in order. Pure."""
    armed = any(is_armed for _, _, is_armed in account.modes)
    climbing = any(moment.height_m > CLIMBING_M for moment in account.flight)
    return tuple(
        phase
        for phase, is_reached in ((TrialPhase.ARMED, armed), (TrialPhase.CLIMBING, climbing))
        if is_reached
    )


class TakeOff:
    """Reads a ground-truth file while a robot engages.

    Args:
        path: the file.
        enter: called, in its own thread, with each phase as it is reached.
    """

    def __init__(self, path: Path, enter: Callable[[TrialPhase], None]) -> None:
        self._path, self._enter = path, enter
        self._from = 0
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._watch, name="take-off", daemon=True)

    def watch(self) -> None:
        """Start monitoring; earlier entries are ignored."""
        self._from = self._path.stat().st_size
        self._thread.start()

    def close(self) -> None:
        """Stop monitoring."""
        self._ended.set()
        if self._thread.ident is not None:
            self._thread.join()

    def _watch(self) -> None:
        with self._path.open() as file:
            file.seek(self._from)
            rest = ""
            while not self._ended.wait(LOOK_S):
                whole, _, rest = (rest + file.read()).rpartition("\n")
                for phase in reached(read_witness(whole)):
                    self._enter(phase)
                    if phase is TrialPhase.CLIMBING:
                        return
