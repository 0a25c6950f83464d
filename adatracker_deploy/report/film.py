"""Renders a trial as a video from its log: every tick's frame and what was sent; nothing is recomputed."""

from __future__ import annotations

import statistics
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.core.messages import Observation, TargetState
from adatracker_deploy.perception.overlay import Drive, overlay

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from adatracker_deploy.core.messages import Twist
    from adatracker_deploy.core.record import StepRecord
    from adatracker_deploy.perception.overlay import Image
    from adatracker_deploy.trial.reader import LoggedFrame, Trial

LEAST_RATE_HZ, LARGEST_RATE_HZ = 1.0, 120.0
_AXES = {
    "forward": ("vx", "forward_m_s"),
    "lateral": ("vy", "lateral_m_s"),
    "vertical": ("vz", "vertical_m_s"),
    "yaw": ("yaw_rate", "yaw_rate_rad_s"),
}
"""For each axis: its field in a twist and its limit in a profile."""


class Shot(NamedTuple):
    """A tick's picture, with everything drawn over it, and the tick's time, ns of the run's clock."""

    picture: Image
    t_ns: int


def film_rate_hz(trial: Trial) -> float:
    """Return the rate at which most ticks came, within what a film can have."""
    gaps_ns = [after.t_ns - before.t_ns for before, after in pairwise(trial.steps)]
    usual_ns = statistics.median(gaps_ns) if gaps_ns else 0.0
    return min(max(1e9 / usual_ns, LEAST_RATE_HZ), LARGEST_RATE_HZ) if usual_ns > 0 else LEAST_RATE_HZ


def shots(trial: Trial) -> Iterator[Shot]:
    """Draw a trial tick by tick; a tick whose frame the log lacks is left out.

    Raises:
        UsageError: the log has no frames.
    """
    if not trial.frame_seqs or not trial.steps:
        raise UsageError(f"{trial.path}: no camera frames in it, so there is no film to make")
    limits = _limits(trial)
    began_ns = trial.steps[0].t_ns
    for step, frame in trial.ticks_with_frames():
        when = f"{(step.t_ns - began_ns) / 1e9:.2f} s"
        drive = None
        if step.stale or step.sent:
            drive = Drive(moves=_moves(step.sent, limits) if step.sent and not step.stale else None)
        picture = overlay(frame.rgb, _observation(step, frame), when, drive, stale=step.stale)
        yield Shot(picture, step.t_ns)


def _observation(step: StepRecord, frame: LoggedFrame) -> Observation:
    state = TargetState(step.target) if step.target else None
    return Observation(frame.mask, step.box, step.confidence, step.t_ns, step.frame_seq, state)


def _limits(trial: Trial) -> dict[str, float]:
    """Return the limit on each axis that was ever used; the greatest speed there where none is known."""
    known: Mapping[str, float] = trial.config.get("profile", {}).get("limits", {})
    found = {}
    for axis, (field, name) in _AXES.items():
        greatest = max((abs(getattr(step.sent, field)) for step in trial.steps if step.sent), default=0.0)
        if greatest > 0:
            found[axis] = known.get(name) or greatest
    return found


def _moves(sent: Twist, limits: Mapping[str, float]) -> dict[str, float]:
    """Return what the link sent, in shares of the limits."""
    return {axis: getattr(sent, _AXES[axis][0]) / limit for axis, limit in limits.items()}
