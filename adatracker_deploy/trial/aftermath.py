"""The link's actions after the end of the tracker's log, from its black box."""

from __future__ import annotations

import contextlib
import math
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

from adatracker_deploy.core.messages import ZERO
from adatracker_deploy.runtime.black_box import FILE_NAME, read_black_box

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from adatracker_deploy.core.messages import Twist
    from adatracker_deploy.runtime.black_box import Moment

STILL_M_S = 0.1
"""Slower than this a robot stands; a drone that hovers in wind may not."""


@dataclass(frozen=True, slots=True)
class Change:
    """The link came to another phase, or to another reason."""

    after_s: float
    """After the log's last step; negative before it."""
    phase: str
    reason: str
    sent: Twist
    speed_m_s: float | None
    """Measured; None where the robot reported none."""


@dataclass(frozen=True, slots=True)
class Aftermath:
    """From the log's last step to the link's last; seconds of the run's clock."""

    lasted_s: float
    told_s: float
    """Until the last command that moves; 0 where none followed."""
    stood_s: float | None
    """Until the robot was slower than `STILL_M_S` for good; None if it never was, or reported no velocity."""
    asleep_s: float
    """For how long the machine was suspended meanwhile."""
    changes: tuple[Change, ...]

    @property
    def summary(self) -> str:
        """In a sentence."""
        told = (
            f"the last command that moves came {self.told_s:.2f} s after it"
            if self.told_s
            else "zero at once"
        )
        stood = (
            "the robot was not seen to stand"
            if self.stood_s is None
            else f"it stood after {self.stood_s:.2f} s"
        )
        asleep = f"; the machine slept for {self.asleep_s:.1f} s" if self.asleep_s > STILL_M_S else ""
        return (
            f"The link went on for {self.lasted_s:.1f} s after the log's last step: {told}, {stood}{asleep}."
        )


def aftermath_of(trial_folder: Path, last_step_ns: int | None) -> Aftermath | None:
    """Return what a trial's black box holds of the time after its log; None without one, or without more.

    Args:
        trial_folder: of the trial.
        last_step_ns: time of the log's last step, ns of the run's clock; None where it has none.
    """
    moments: tuple[Moment, ...] = ()
    with contextlib.suppress(OSError, ValueError):
        moments = read_black_box(trial_folder / FILE_NAME)
    return aftermath(moments, last_step_ns)


def aftermath(moments: Sequence[Moment], last_step_ns: int | None) -> Aftermath | None:
    """Return what moments tell, in their order, of the time after a log's last step."""
    since_ns = last_step_ns if last_step_ns is not None else moments[0].status.t_ns if moments else 0
    later = [moment for moment in moments if moment.status.t_ns > since_ns]
    if not later:
        return None

    def after_s(moment: Moment) -> float:
        return (moment.status.t_ns - since_ns) / 1e9

    fast = [after_s(each) for each in later if not (_speed(each) or 0.0) < STILL_M_S]
    knows = any(_speed(each) is not None for each in later)
    stands = knows and (_speed(later[-1]) or 0.0) < STILL_M_S
    first, last = later[0], later[-1]
    changed = [later[0], *(after for before, after in pairwise(later) if _what(before) != _what(after))]
    return Aftermath(
        lasted_s=after_s(last),
        told_s=max((after_s(each) for each in later if each.status.sent != ZERO), default=0.0),
        stood_s=max(fast, default=0.0) if stands else None,
        asleep_s=(last.boottime_ns - last.monotonic_ns - first.boottime_ns + first.monotonic_ns) / 1e9,
        changes=tuple(
            Change(after_s(each), *_what(each), each.status.sent, _speed(each)) for each in changed
        ),
    )


def _what(moment: Moment) -> tuple[str, str]:
    status = moment.status
    return str(status.phase), status.stopped


def _speed(moment: Moment) -> float | None:
    velocity = moment.status.state.velocity
    return None if velocity is None else math.hypot(velocity.vx, velocity.vy, velocity.vz)
