"""Runs a fleet: starts its robots together, watches them, and stops all with one stop.

Each robot's run is a process of its own, with its own link, camera, policy and log, and stops by itself as it
would alone. All of them hold the read end of one pipe as their `--stop-fd`. Its write end is this process's
alone: closing it stops all at once, and so does the end of this process, whatever ends it.
"""

from __future__ import annotations

import contextlib
import os
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Self

from adatracker_deploy.app.fleet_member import Member
from adatracker_deploy.app.fleet_steps import REFUSED, Step, next_step
from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.runtime.start_line import CHECKED
from adatracker_deploy.runtime.stopping import ANSWER_S, END_S

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from pathlib import Path
    from types import TracebackType

    from adatracker_deploy.config.fleet import OnFailure

POLL_S = 0.02
_STAGES = ("all requests are right; connecting", "all are ready; starting")


@dataclass(frozen=True, slots=True, kw_only=True)
class Ended:
    """Result of one robot's run."""

    name: str
    status: int
    """Exit status; negative for the signal that killed it."""
    result: dict[str, Any] | None
    """The object that it printed with ``--json``: a trial's summary, or a set's."""

    @property
    def summaries(self) -> list[dict[str, Any]]:
        """Its trials' summaries."""
        if self.result is None:
            return []
        trials: list[dict[str, Any]] = self.result.get("trials", [self.result])
        return trials


class FleetRun:
    """A fleet under way; as a context manager, it leaves no robot running.

    Args:
        robots: each robot's name and command line.
        folder: of this run; each robot logs into a folder of its own there.
        on_failure: what the others do when a robot fails.
        tell: receives a robot's name (empty for the fleet's own) and a line.
    """

    def __init__(
        self,
        robots: Mapping[str, Sequence[str]],
        folder: Path,
        on_failure: OnFailure,
        tell: Callable[[str, str], None],
    ) -> None:
        self._on_failure = on_failure
        self._tell = tell
        self._released = 0
        self._stopped = False
        self.members: list[Member] = []
        stop_fd, self._lifeline = os.pipe()
        try:
            for name, arguments in robots.items():
                self.members.append(Member(name, arguments, folder / name, stop_fd))
        except BaseException:
            self._close()
            raise
        finally:
            os.close(stop_fd)

    def run(self, meanwhile: Callable[[], None] = lambda: None) -> None:
        """Start the robots together and watch them, until all have ended.

        Args:
            meanwhile: called again and again; what it raises ends the watch.

        Raises:
            UsageError: a robot's request is refused; nothing was opened.
            KeyboardInterrupt: the operator stops; `stop` must follow.
        """
        while True:
            meanwhile()
            standings = [member.standing() for member in self.members]
            step, because = next_step(standings, self._released, self._on_failure)
            if step is Step.STOP and not self._stopped:
                self._stop_for(because)
            elif step is Step.RELEASE and not self._stopped:
                self._tell("", _STAGES[self._released])
                self._released += 1
                for member in self.members:
                    member.release()
            if self._released:
                self._relay()
            if step is Step.OVER:
                self._refuse_wrong()
                self._relay()
                return
            time.sleep(POLL_S)

    def _stop_for(self, name: str) -> None:
        if self._released:
            self._relay()
            self._tell("", f"{name} has failed: all stop")
        self.stop()

    def _refuse_wrong(self) -> None:
        for member in self.members:
            standing = member.standing()
            if standing.status == REFUSED and standing.reached < CHECKED:
                raise UsageError(f"{member.name}: {member.refusal()}")

    def stop(self) -> None:
        """Stop all robots and wait until their runs have ended; one that does not answer is killed.

        Its link then brings its robot to rest. May be called again, also when it was interrupted.
        """
        if not self._stopped:
            self._stopped = True
            os.close(self._lifeline)
            for member in self.members:
                member.turn_back()
        began_s = time.monotonic()
        deaf = self._until(began_s + ANSWER_S, Member.has_heard)
        for member in deaf:
            member.kill()
            self._tell("", f"{member.name} did not answer and was killed: its link stops the robot")
        for member in self._until(began_s + END_S, lambda one: one.standing().status is not None):
            member.kill()
            self._tell("", f"{member.name} did not end and was killed: see whether the robot stands")

    def _until(self, end_s: float, condition: Callable[[Member], bool]) -> list[Member]:
        """Wait until a condition holds for all; return those for which it does not by `end_s`, monotonic."""
        while True:
            if self._released:
                self._relay()
            left = [member for member in self.members if not condition(member)]
            if not left or time.monotonic() > end_s:
                return left
            time.sleep(POLL_S)

    def ended(self) -> list[Ended]:
        """Wait for all, and return how each ended."""
        return [
            Ended(name=member.name, status=member.wait(), result=member.result()) for member in self.members
        ]

    def forget(self, folder: Path) -> None:
        """Remove the folder of a run that was refused; one with a log in it stays."""
        for member in self.members:
            member.forget()
        with contextlib.suppress(OSError):
            folder.rmdir()

    def _relay(self) -> None:
        for member in self.members:
            for line in member.news():
                self._tell(member.name, line)

    def _close(self) -> None:
        self.stop()
        for member in self.members:
            member.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._close()
