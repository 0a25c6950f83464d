"""Monitors a row's processes through /proc: which run, are stopped or gone, and how busy the cores are.

Its observations are evidence that a fault took effect, independent of the injector.
"""

from __future__ import annotations

import contextlib
import os
import threading
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Literal, Self

from adatracker_deploy.runtime.link_process import PROCESS_NAME
from adatracker_deploy.sim.ground_truth import read_witness

if TYPE_CHECKING:
    from collections.abc import Iterator

LOOK_S = 0.04
_NS_A_TICK = 1_000_000_000 // os.sysconf("SC_CLK_TCK")

Role = Literal["tracker", "link", "robot"]
State = Literal["runs", "stopped", "gone"]


@dataclass(frozen=True, slots=True)
class Seen:
    """The observations; times are the machine's monotonic time, ns."""

    states: tuple[tuple[int, Role, State], ...] = ()
    """(time, process role, its state from then on)."""
    busy_ns: tuple[tuple[int, int], ...] = ()
    """(time, total processor time of all programs so far)."""

    def first(self, role: Role, state: State, since_ns: int, until_ns: int) -> int | None:
        """Return when a process was first seen in a state within an interval; None if never."""
        return next(
            (
                t_ns
                for t_ns, who, what in self.states
                if (who, what) == (role, state) and since_ns <= t_ns <= until_ns
            ),
            None,
        )

    def busy_cores(self, since_ns: int, until_ns: int) -> float:
        """Return the mean number of busy cores within an interval; 0 where it was not monitored."""
        span = [(t_ns, busy_ns) for t_ns, busy_ns in self.busy_ns if since_ns <= t_ns <= until_ns]
        if len(span) < 2:
            return 0.0
        (began_ns, before_ns), (ended_ns, after_ns) = span[0], span[-1]
        return (after_ns - before_ns) / (ended_ns - began_ns)


@dataclass
class ProcessMonitor:
    """Context that monitors a row's processes.

    Args:
        tracker: its process id; the link is the child with the link's name.
        witness: the ground-truth file, in which the robot records its process id, and the tracker its first
            link's.
    """

    tracker: int
    witness: Path
    _states: list[tuple[int, Role, State]] = field(default_factory=list)
    _busy_ns: list[tuple[int, int]] = field(default_factory=list)
    _link: int = 0
    _robot: int = 0
    _ended: threading.Event = field(default_factory=threading.Event)

    def __enter__(self) -> Self:
        self._thread = threading.Thread(target=self._run, name="watch", daemon=True)
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ended.set()
        self._thread.join()

    @property
    def link_lives(self) -> bool:
        """Whether the last link seen still runs."""
        return bool(self._link) and _state(self._link) != "gone"

    def seen(self) -> Seen:
        """Return all observations so far."""
        return Seen(tuple(self._states), tuple(self._busy_ns))

    def _run(self) -> None:
        last: dict[Role, State] = {}
        while True:
            ended = self._ended.wait(LOOK_S)  # then look once more: the end itself counts
            now_ns = time.monotonic_ns()
            self._link = next(_links_of(self.tracker), 0) or self._link
            if not (self._robot and self._link) and self.witness.exists():
                account = read_witness(self.witness.read_text())
                self._robot = account.process("robot") or 0
                self._link = self._link or account.process("link") or 0
            pids: dict[Role, int] = {"tracker": self.tracker, "link": self._link, "robot": self._robot}
            for role, pid in pids.items():
                if pid and (state := _state(pid)) != last.get(role):
                    last[role] = state
                    self._states.append((now_ns, role, state))
            self._busy_ns.append((now_ns, _all_busy_ns()))
            if ended:
                return


def _state(pid: int) -> State:
    with contextlib.suppress(OSError, IndexError):
        letter = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
        return "gone" if letter in "ZX" else "stopped" if letter in "Tt" else "runs"
    return "gone"


def _links_of(tracker: int) -> Iterator[int]:
    with contextlib.suppress(OSError):
        for pid in Path(f"/proc/{tracker}/task/{tracker}/children").read_text().split():
            with contextlib.suppress(OSError):
                if Path(f"/proc/{pid}/comm").read_text().strip() == PROCESS_NAME:
                    yield int(pid)


def _all_busy_ns() -> int:
    """Return the processor time of all cores that was not idle, since boot (proc(5), /proc/stat)."""
    first = Path("/proc/stat").read_text().partition("\n")[0].split()[1:9]
    user, nice, system, _idle, _iowait, irq, softirq, steal = map(int, first)
    return (user + nice + system + irq + softirq + steal) * _NS_A_TICK
