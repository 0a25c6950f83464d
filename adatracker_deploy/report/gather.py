"""Reads a report's data from the logs; the only module here that opens files."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import cv2
import numpy as np

from adatracker_deploy.core.messages import Observation, TargetState
from adatracker_deploy.perception.overlay import overlay
from adatracker_deploy.report.columns import Columns, columns
from adatracker_deploy.scoring.summary import summarise_log
from adatracker_deploy.trial.reader import read_trial

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from adatracker_deploy.core.record import StepRecord
    from adatracker_deploy.scoring.tally import Summary
    from adatracker_deploy.trial.reader import LoggedFrame, Trial

PICTURE_HEIGHT_PX = 360
_JPEG_QUALITY = 80
_STATES = {state.value: state for state in TargetState}


@dataclass(frozen=True, slots=True)
class Moment:
    """A picture worth showing."""

    name: str
    time_s: float
    """From the first tick."""
    jpeg: bytes | None
    """None where the log has no such frame."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Event:
    """A line of the log."""

    time_s: float | None
    """From the first tick; None in a log that does not say when its clock was read."""
    level: str
    message: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Report:
    """One trial, ready to be shown."""

    trial: Trial
    summary: Summary
    """As `score` gives it."""
    columns: Columns | None
    """None without a single step."""
    events: tuple[Event, ...]


def gather(path: Path) -> Report:
    """Read a trial and score it.

    Raises:
        UsageError: it is not one.
    """
    trial = read_trial(path)
    return Report(
        trial=trial,
        summary=summarise_log(trial),
        columns=columns(trial.steps) if trial.steps else None,
        events=_events(trial),
    )


def moments(trial: Trial) -> list[Moment]:
    """Return the pictures at the start, the first loss, the re-acquisition and the end; not all need be."""
    chosen = key_steps(trial.steps)
    frames = {frame.seq: frame for frame in trial.frames({step.frame_seq for step in chosen.values()})}
    return [
        Moment(name, _since_start_s(trial, step), _picture(step, frames.get(step.frame_seq), trial))
        for name, step in chosen.items()
    ]


def key_steps(steps: Sequence[StepRecord]) -> dict[str, StepRecord]:
    """Choose the first step with a box, the first lost after it, the next with one, and the last of all."""
    chosen: dict[str, StepRecord] = {}
    names = iter(("start", "first loss", "seen again"))
    seen = True
    for step in steps:
        if not step.stale and (step.box is not None) == seen:
            name = next(names, None)
            if name is None:
                break
            chosen[name] = step
            seen = not seen
    if steps:
        chosen["end"] = steps[-1]
    return chosen


def _since_start_s(trial: Trial, step: StepRecord) -> float:
    return (step.t_ns - trial.steps[0].t_ns) / 1e9


def _picture(step: StepRecord, frame: LoggedFrame | None, trial: Trial) -> bytes | None:
    """Draw a frame as ``view`` shows it; what the step says of the target is drawn, not what is guessed."""
    if frame is None:
        return None
    state = _STATES.get(step.target or "")
    if state is None and step.box is None and not step.stale:
        state = TargetState.LOST
    seen = Observation(frame.mask, step.box, step.confidence, step.t_ns, frame.seq, state)
    picture = overlay(frame.rgb, seen, f"{_since_start_s(trial, step):.1f} s", stale=step.stale)
    height, width = picture.shape[:2]
    if height > PICTURE_HEIGHT_PX:
        size = (round(width * PICTURE_HEIGHT_PX / height), PICTURE_HEIGHT_PX)
        picture = np.asarray(cv2.resize(picture, size, interpolation=cv2.INTER_AREA))
    bgr = cv2.cvtColor(picture, cv2.COLOR_RGB2BGR)
    _, jpeg = cv2.imencode(".jpg", bgr, (cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY))
    return bytes(jpeg.tobytes())


def _events(trial: Trial) -> tuple[Event, ...]:
    """Put events on the run's clock; they are logged with wall-clock time, as ticks are in every viewer."""
    offset_ns = trial.wall_offset_ns
    if offset_ns is None or not trial.steps:
        return tuple(Event(time_s=None, level=event.level, message=event.message) for event in trial.events)
    first_ns = trial.steps[0].t_ns + offset_ns
    return tuple(
        Event(time_s=(event.wall_ns - first_ns) / 1e9, level=event.level, message=event.message)
        for event in trial.events
    )
