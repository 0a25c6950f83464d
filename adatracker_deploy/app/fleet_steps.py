"""A fleet's next step, from how far each of its robots is: a pure function."""

from __future__ import annotations

import signal
from dataclasses import dataclass
from enum import Enum
from typing import TYPE_CHECKING

from adatracker_deploy.runtime.start_line import CHECKED, READY

if TYPE_CHECKING:
    from collections.abc import Sequence

    from adatracker_deploy.config.fleet import OnFailure

DONE, FAILED, REFUSED, INTERRUPTED = 0, 1, 2, 130
"""A run's exit statuses."""
_WORST_FIRST = (FAILED, REFUSED, INTERRUPTED, DONE)
_TOLD_TO_END = (-signal.SIGINT, -signal.SIGTERM)
"""Exit statuses of a run that was stopped so early that it did not handle signals yet."""


class Step(Enum):
    """The next action of the fleet's command."""

    WAIT = "wait"
    RELEASE = "release"
    """All that still run have reached the stage: they may go on to the next."""
    STOP = "stop"
    OVER = "over"


@dataclass(frozen=True, slots=True)
class Standing:
    """Progress of one robot's run."""

    name: str
    reached: int
    """Stages that it has reached (`runtime.start_line`)."""
    status: int | None
    """Its exit status; None while it runs."""


def next_step(standings: Sequence[Standing], released: int, on_failure: OnFailure) -> tuple[Step, str]:
    """Return what to do next, and, for a stop, the robot because of which.

    A request that is refused before anything was opened stops all, whatever `on_failure` says: the file is
    wrong. Later, a robot that fails stops all, or with ``go-on`` only itself. A lost target is no failure.

    Args:
        standings: of all robots.
        released: the last stage from which they were released, 0 to `READY`.
        on_failure: as the file says.
    """
    running = [one for one in standings if one.status is None]
    if not running:
        return Step.OVER, ""
    for one in standings:
        failed = one.status is not None and (one.status != DONE or one.reached < READY)
        if failed and (on_failure == "stop-all" or one.reached < CHECKED):
            return Step.STOP, one.name
    if released < READY and all(one.reached > released for one in running):
        return Step.RELEASE, ""
    return Step.WAIT, ""


def worst(statuses: Sequence[int]) -> int:
    """Return a fleet's exit status: a failure before a wrong request, that before an interrupt, then 0.

    A run that was killed, or that ended in any other way, has failed.
    """
    return min(map(_known, statuses), key=_WORST_FIRST.index, default=FAILED)


def _known(status: int) -> int:
    if status in _TOLD_TO_END:
        return INTERRUPTED
    return status if status in _WORST_FIRST else FAILED
