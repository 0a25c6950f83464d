"""Progress display of a run: a changing line in a terminal, occasional lines elsewhere."""

from __future__ import annotations

import contextlib
import math
import time
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from rich.console import Console

    from adatracker_deploy.core.record import StepRecord

LINE_EVERY_S = 5.0
REDRAW_EVERY_S = 0.1


class Progress:
    """Shows phases and steps on a console.

    Args:
        console: where.
        steps: of the trial, planned.
        logging: called with the folder of the trial's log.
    """

    def __init__(self, console: Console, steps: int, logging: Callable[[Path], None]) -> None:
        self._console = console
        self.logging = logging
        self._steps = steps
        self._shown_s = -math.inf
        self._first: StepRecord | None = None

    def phase(self, text: str) -> None:
        """Say what happens now."""
        self._clear()
        self._print(text, highlight=False, soft_wrap=True)  # an address in it stays in one piece

    def step(self, record: StepRecord) -> None:
        """Show a step, if the last one shown is old enough."""
        self._first = self._first or record
        now_s = time.monotonic()
        live = self._console.is_terminal
        if now_s - self._shown_s < (REDRAW_EVERY_S if live else LINE_EVERY_S):
            return
        self._shown_s = now_s
        line = self._line(record, self._first)
        if live:
            self._clear()
            self._print(line, end="\r", highlight=False, no_wrap=True, overflow="crop")
        else:
            self._print(line, highlight=False)

    def _print(self, *what: Any, **how: Any) -> None:
        """Print, if anybody is there to read it: a terminal or a pipe that is gone must not end a trial."""
        with contextlib.suppress(OSError, SystemExit):  # rich exits when a pipe is closed
            self._console.print(*what, **how)

    def _clear(self) -> None:
        if self._console.is_terminal:
            self._print(" " * (self._console.width - 1), end="\r")

    def _line(self, record: StepRecord, first: StepRecord) -> str:
        where = (
            f"distance {record.distance_m:.2f} m  bearing {math.degrees(record.bearing_rad):+4.0f} deg"
            if record.distance_m is not None and record.bearing_rad is not None
            else f"target at {record.box.cx:.2f}, {record.box.cy:.2f}"
            if record.box
            else ""
        )
        passed_s = (record.t_ns - first.t_ns) / 1e9
        rate = f"{(record.step - first.step) / passed_s:4.1f} Hz" if passed_s > 0 else ""
        late = "  answer too late" if record.latency.infer_ms else "  frame too old"
        lost = "  target lost, searching" if record.searching else "  target lost"
        seen = late if record.stale else "" if record.box else lost
        return (
            f"  {record.step:4d}/{self._steps}  {where}  {rate}"
            f"  late {record.latency.lateness_ms:.1f} ms  missed {record.missed_deadlines}{seen}"
        )
