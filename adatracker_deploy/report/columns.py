"""A trial's steps as columns of numbers, and the intervals in which a flag held."""

from __future__ import annotations

import math
import statistics
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from adatracker_deploy.core.task import box_reward
from adatracker_deploy.runtime.gate.reasons import limited, withheld

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

    from adatracker_deploy.core.messages import Box, Twist
    from adatracker_deploy.core.record import StepRecord

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

AXES = ("vx", "vy", "vz", "yaw_rate")


class Interval(NamedTuple):
    """From when to when, s."""

    start_s: float
    end_s: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Columns:
    """One value a step, shape (T,), T >= 1; float64, NaN where there is none."""

    time_s: Floats
    """Start of the tick, from the first one's."""
    period_s: float
    """The usual time between two ticks."""
    reward: Floats
    """R against the first box, 0 while the target is lost; NaN while stale, when it is not known."""
    centre_error: Floats
    """Distance of the box's centre from the first one's, in fractions of the image."""
    size_error: Floats
    """L2 norm of the change of width and height, likewise."""
    lost: Flags
    stopped: Flags
    """The command was withheld: by the gate, or because the observation was too old to act on."""
    limited: Flags
    """The gate changed the command to keep it inside the limits."""
    asked: dict[str, Floats]
    """The policy's action as velocities, by axis of `AXES`, m/s and rad/s."""
    sent: dict[str, Floats]
    measured: dict[str, Floats]
    latency_ms: Floats
    """From the frame's capture to the set-point."""
    link_age_s: Floats
    battery: Floats
    missed: Flags
    """Slots were skipped before this tick."""

    @property
    def duration_s(self) -> float:
        """From the first tick's beginning to the last one's end."""
        return float(self.time_s[-1]) + self.period_s

    def stretches(self, flags: Flags) -> list[Interval]:
        """Return when the flags held; a tick lasts until the next begins."""
        edges = np.flatnonzero(np.diff(np.concatenate(([False], flags, [False])).astype(np.int8)))
        ends = np.append(self.time_s, self.duration_s)
        return [
            Interval(float(ends[start]), float(ends[end]))
            for start, end in zip(edges[::2], edges[1::2], strict=True)
        ]


def columns(steps: Sequence[StepRecord]) -> Columns:
    """Turn records, ordered by step, into columns.

    Raises:
        ValueError: there are none.
    """
    if not steps:
        raise ValueError("no steps to show")
    reference = next((step.box for step in steps if step.box is not None), None)
    time_s = _floats((step.t_ns - steps[0].t_ns) / 1e9 for step in steps)
    missed = np.array([step.missed_deadlines for step in steps])
    return Columns(
        time_s=time_s,
        period_s=statistics.median(np.diff(time_s)) if len(steps) > 1 else 0.05,
        reward=_floats(
            _with(reference, step.box, box_reward, math.nan if step.stale else 0.0) for step in steps
        ),
        centre_error=_floats(_with(reference, step.box, _centre_error, math.nan) for step in steps),
        size_error=_floats(_with(reference, step.box, _size_error, math.nan) for step in steps),
        lost=np.array([step.box is None and not step.stale for step in steps]),
        stopped=np.array([step.stale or withheld(step.gate) for step in steps]),
        limited=np.array([limited(step.gate) for step in steps]),
        asked=_by_axis([step.command for step in steps]),
        sent=_by_axis([step.sent for step in steps]),
        measured=_by_axis([step.velocity for step in steps]),
        latency_ms=_floats(step.latency.sensor_to_command_ms for step in steps),
        link_age_s=_floats(step.state_age_s for step in steps),
        battery=_floats(math.nan if step.battery is None else step.battery for step in steps),
        missed=np.diff(missed, prepend=0) > 0,
    )


def _floats(values: Iterable[float]) -> Floats:
    """Return an array; what is infinite has no place in a chart either."""
    array = np.fromiter(values, np.float64)
    array[~np.isfinite(array)] = np.nan
    return array


def _by_axis(twists: Sequence[Twist | None]) -> dict[str, Floats]:
    return {
        axis: _floats(math.nan if twist is None else getattr(twist, axis) for twist in twists)
        for axis in AXES
    }


def _with(
    reference: Box | None, box: Box | None, measure: Callable[[Box, Box], float], absent: float
) -> float:
    return absent if box is None or reference is None else measure(box, reference)


def _centre_error(box: Box, reference: Box) -> float:
    return math.hypot(box.cx - reference.cx, box.cy - reference.cy)


def _size_error(box: Box, reference: Box) -> float:
    return math.hypot(box.w - reference.w, box.h - reference.h)
