"""Exports a trial as a Rerun recording: images, mask, box and all measurements on one timeline.

Rerun's own reader of MCAP wants chunks, which a log that survives a power cut does not have. JPEGs are passed
on as they are. Timelines: `time`, since the first tick, and `tick`.
"""

from __future__ import annotations

from dataclasses import fields
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np

from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.core.mask_png import PALETTE
from adatracker_deploy.core.messages import MaskClass, Twist
from adatracker_deploy.scoring.stages import FAR_STAGES, STAGES

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from adatracker_deploy.core.record import StepRecord
    from adatracker_deploy.trial.reader import Trial

TIME, TICK = "time", "tick"
_LEVELS = {"warning": "WARN", "fatal": "CRITICAL"}
"""Rerun's names where they differ from Foxglove's."""
_AXES = tuple(field.name for field in fields(Twist))
_TWISTS = ("velocity/asked", "velocity/sent", "velocity/measured")

Series = dict[int, float]
"""A number at some of the ticks, by their place."""


def write_rerun(trial: Trial, path: Path) -> None:
    """Write a trial as an ``.rrd``.

    Raises:
        UsageError: the `rerun` extra is not installed, there are no ticks, or the file cannot be written.
    """
    try:
        import rerun as rr
    except ImportError as error:
        raise UsageError("Rerun's SDK is not installed: pip install 'adatracker-deploy[rerun]'") from error
    if not trial.steps:
        raise UsageError(f"{trial.path}: no ticks in it, so there is nothing to show")
    try:
        path.open("wb").close()  # the SDK itself fails without a word
    except OSError as error:
        raise UsageError(f"--out {path}: cannot be written: {error.strerror}") from error
    recording = rr.RecordingStream("adatracker-deploy", recording_id=trial.path.parent.name)
    recording.save(path, default_blueprint=_blueprint())
    _write_pictures(rr, recording, trial)
    times_ns = np.array([step.t_ns - trial.steps[0].t_ns for step in trial.steps])
    ticks = np.array([step.step for step in trial.steps])
    for name, series in all_series(trial.steps).items():
        places = list(series)
        recording.send_columns(
            name,
            indexes=[
                rr.TimeColumn(TIME, duration=times_ns[places].astype("timedelta64[ns]")),
                rr.TimeColumn(TICK, sequence=ticks[places]),
            ],
            columns=rr.Scalars.columns(scalars=np.array(list(series.values()))),
        )
    _write_events(rr, recording, trial)
    recording.disconnect()


def all_series(steps: Sequence[StepRecord]) -> dict[str, Series]:
    """Return everything that can be plotted, by its path; without what was never known or never moved."""
    found: dict[str, Series] = {}
    for place, step in enumerate(steps):
        for name, value in _numbers(step).items():
            if value is not None and np.isfinite(value):
                found.setdefault(name, {})[place] = float(value)
    moved = {axis for axis in _AXES if any(any(found.get(f"{kind}/{axis}", {}).values()) for kind in _TWISTS)}
    still = {f"{kind}/{axis}" for kind in _TWISTS for axis in set(_AXES) - moved}
    return {name: series for name, series in found.items() if name not in still}


def _numbers(step: StepRecord) -> Mapping[str, float | None]:
    twists = zip(_TWISTS, (step.command, step.sent, step.velocity), strict=True)
    latency = step.latency
    return {
        **{f"{name}/{axis}": getattr(twist, axis) for name, twist in twists if twist for axis in _AXES},
        **{f"action/{place}": value for place, value in enumerate(step.action)},
        **{f"context/{place:02}": value for place, value in enumerate(step.context)},
        **{f"latency_ms/{stage}": getattr(latency, f"{stage}_ms") for stage in (*STAGES, *FAR_STAGES)},
        "latency_ms/lateness": latency.lateness_ms,
        "target/confidence": step.confidence,
        "truth/distance_m": step.distance_m,
        "truth/bearing_rad": step.bearing_rad,
        **(
            {f"pose/{name}": getattr(step.pose, name) for name in ("x", "y", "z", "yaw")} if step.pose else {}
        ),
        "robot/battery": step.battery,
        "robot/state_age_s": step.state_age_s,
    }


def _write_pictures(rr: Any, recording: Any, trial: Trial) -> None:
    """Write frames, masks and boxes, each at the tick that acted on it."""
    names = [(kind.value, kind.name.lower(), PALETTE[kind]) for kind in MaskClass]
    recording.log("camera", rr.AnnotationContext(names), static=True)
    began_ns = trial.steps[0].t_ns
    for step, frame in trial.ticks_with_frames():
        recording.set_time(TIME, duration=np.timedelta64(step.t_ns - began_ns, "ns"))
        recording.set_time(TICK, sequence=step.step)
        height, width = frame.rgb.shape[:2]
        mask = cv2.resize(frame.mask, (width, height), interpolation=cv2.INTER_NEAREST)
        recording.log("camera/picture", rr.EncodedImage(contents=frame.jpeg, media_type="image/jpeg"))
        recording.log("camera/mask", rr.SegmentationImage(mask, opacity=0.4))
        if step.box is None:
            recording.log("camera/target", rr.Clear(recursive=False))
            continue
        px = np.array([width, height])
        box = rr.Boxes2D(
            centers=[px * (step.box.cx, step.box.cy)],
            sizes=[px * (step.box.w, step.box.h)],
            colors=[PALETTE[MaskClass.TARGET]],
            labels=[step.target or "target"],
        )
        recording.log("camera/target", box)


def _write_events(rr: Any, recording: Any, trial: Trial) -> None:
    """Write the log's lines at their time; at no time where the log does not say how its clocks relate."""
    recording.reset_time()
    began_ns = None if trial.wall_offset_ns is None else trial.steps[0].t_ns + trial.wall_offset_ns
    for event in trial.events:
        if began_ns is not None:
            recording.set_time(TIME, duration=np.timedelta64(event.wall_ns - began_ns, "ns"))
        line = rr.TextLog(event.message, level=_LEVELS.get(event.level, event.level.upper()))
        recording.log("events", line, static=began_ns is None)


def _blueprint() -> Any:
    import rerun.blueprint as rrb

    plots = [rrb.TimeSeriesView(origin=name, name=name) for name in ("velocity", "truth", "latency_ms")]
    left = rrb.Vertical(
        rrb.Spatial2DView(origin="camera"), rrb.TextLogView(origin="events"), row_shares=[3, 1]
    )
    return rrb.Blueprint(rrb.Horizontal(left, rrb.Vertical(*plots)), collapse_panels=True)
