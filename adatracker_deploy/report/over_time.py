"""Sections of a trial's page that are drawn over time, and the latency."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from adatracker_deploy.core.record import BY_HAND
from adatracker_deploy.report.charts import (
    COLUMNS,
    Band,
    Curve,
    Span,
    histogram,
    key,
    lane,
    nice_above,
    number,
    strip,
    time_axis,
)
from adatracker_deploy.report.columns import Interval
from adatracker_deploy.report.markup import Html, tag
from adatracker_deploy.report.page import figure, section, shortened, table
from adatracker_deploy.scoring.stages import FAR_STAGES, STAGES

if TYPE_CHECKING:
    from collections.abc import Sequence

    from adatracker_deploy.core.record import StepRecord
    from adatracker_deploy.report.columns import Columns, Floats
    from adatracker_deploy.report.gather import Event, Report

HISTOGRAM_BARS = 40
_AXES = {
    "vx": ("forward", "m/s"),
    "vy": ("left", "m/s"),
    "vz": ("up", "m/s"),
    "yaw_rate": ("yaw", "rad/s"),
}
_TARGET_LOOKS = {
    "seen": "s-good",
    "tracked": "s-good",
    "reacquired": "s-new",
    "coasting": "s-fair",
    "lost": "s-bad",
    "choosing": "s-b",
    "stale": "s-c",
}
_MODE_LOOKS = ("s-a", "s-b", "s-c", "s-d")
_LEVEL_LOOKS = {"info": "s-a", "warning": "s-fair", "error": "s-bad"}
_USUAL = ("seen", "tracked")


def over_time(report: Report, cols: Columns) -> list[Html]:
    """Return the parts that show a trial over its time, and where that time went."""
    span = Span(cols.time_s, cols.duration_s, cols.stretches(cols.lost), cols.stretches(cols.stopped))
    return [
        _timeline(report, cols, span),
        _tracking(cols, span, report.trial.steps),
        _driving(cols, span, report.trial.steps),
        _health(cols, span),
        _latency(cols, report),
    ]


def _timeline(report: Report, cols: Columns, span: Span) -> Html:
    steps = report.trial.steps
    target = _states(cols, [_target(step) for step in steps])
    modes = _states(cols, [step.mode or "unnamed" for step in steps])
    whole = [Interval(0.0, span.length_s)]
    gate = [
        Band("obeyed", "s-good", [] if (cols.limited | cols.stopped).all() else whole),
        Band("kept inside the limits", "s-fair", cols.stretches(cols.limited & ~cols.stopped)),
        Band("command withheld", "s-bad", span.stopped, rare=True),
    ]
    by_hand = np.array([step.driver == BY_HAND for step in steps])
    searching = np.array([step.searching for step in steps])
    drivers = [
        Band("policy", "s-a", cols.stretches(~by_hand & ~searching), rare=True),
        Band("policy, searching", "s-fair", cols.stretches(searching)),
        Band("hand", "s-b", cols.stretches(by_hand)),
    ]
    notes = [
        Band(level, look, _at(report.events, level, span.length_s), rare=True)
        for level, look in _LEVEL_LOOKS.items()
    ]
    notes.append(Band("missed deadline", "s-b", cols.stretches(cols.missed), rare=True))
    return section(
        "Timeline",
        lane(
            "target",
            span,
            [
                Band(name, _TARGET_LOOKS.get(name, "s-d"), target[name], rare=name not in _USUAL)
                for name in sorted(target, key=lambda name: name not in _USUAL)
            ],
        ),
        lane("driver", span, drivers) if (by_hand | searching).any() else None,
        lane("gate", span, gate),
        lane(
            "robot's mode",
            span,
            [
                Band(
                    shortened(name, 40), _MODE_LOOKS[min(place, len(_MODE_LOOKS) - 1)], found, rare=place > 0
                )
                for place, (name, found) in enumerate(modes.items())
            ],
        ),
        lane("events", span, notes) if any(band.stretches for band in notes) else None,
        time_axis(span.length_s),
    )


def _target(step: StepRecord) -> str:
    """Say what was known of the target."""
    return "stale" if step.stale else step.target or ("seen" if step.box else "lost")


def _states(cols: Columns, names: Sequence[str]) -> dict[str, list[Interval]]:
    """Return when each state held, in the order of their first steps."""
    array = np.array(names, dtype=object)
    return {name: cols.stretches(array == name) for name in dict.fromkeys(names)}


def _at(events: Sequence[Event], level: str, length_s: float) -> list[Interval]:
    times = sorted(event.time_s for event in events if event.level == level and event.time_s is not None)
    return [Interval(time_s, time_s) for time_s in times if 0 <= time_s <= length_s]


def _tracking(cols: Columns, span: Span, steps: Sequence[StepRecord]) -> Html:
    most = nice_above(_greatest(cols.centre_error, cols.size_error))
    errors = [
        Curve("centre", "c-sent", cols.centre_error),
        Curve("width and height", "c-measured", cols.size_error),
    ]
    charts = [
        strip("R", span, [Curve("R", "c-main", cols.reward)], 0.0, 1.0, wanted=1.0),
        strip("box error", span, errors, 0.0, most, unit="of the image"),
    ]
    distance = np.array([np.nan if step.distance_m is None else step.distance_m for step in steps])
    bearing = np.degrees([np.nan if step.bearing_rad is None else step.bearing_rad for step in steps])
    if np.isfinite(distance).any():
        far = nice_above(max(5.0, _greatest(distance)))
        charts.append(
            strip("distance", span, [Curve("", "c-main", distance)], 0.0, far, wanted=2.5, unit="m")
        )
    if np.isfinite(bearing).any():
        wide = nice_above(max(45.0, _greatest(np.abs(bearing))))
        charts.append(
            strip("bearing", span, [Curve("", "c-main", bearing)], -wide, wide, wanted=0.0, unit="deg")
        )
    note = None
    if len(steps) > 3 * COLUMNS:
        words = f"Curves of so many steps show the least and the greatest value of each of {COLUMNS} columns."
        note = tag("p", words, class_="faint")
    return section("Tracking", *charts, time_axis(span.length_s), _shades(span), note)


def _shades(span: Span) -> Html | None:
    keys = [key("target lost", "lost")] if span.lost else []
    keys += [key("command withheld", "stopped")] if span.stopped else []
    return tag("div", "shaded: ", *keys, class_="keys alone") if keys else None


def _driving(cols: Columns, span: Span, steps: Sequence[StepRecord]) -> Html:
    charts, by_hand = [], any(step.driver == BY_HAND for step in steps)
    for axis, (name, unit) in _AXES.items():
        curves = [
            Curve("asked by the driver" if by_hand else "asked by the policy", "c-asked", cols.asked[axis]),
            Curve("sent by the gate", "c-sent", cols.sent[axis]),
            Curve("measured", "c-measured", cols.measured[axis]),
        ]
        if not any(np.nan_to_num(curve.values).any() for curve in curves[:2]):
            continue  # an axis that this robot does not have
        low, high = _scale(curves)
        charts.append(strip(name, span, curves, low, high, wanted=0.0, unit=unit))
    if not charts:
        charts.append(tag("p", "Nothing was asked of the robot.", class_="faint"))
    return section("Action, command, motion", *charts, time_axis(span.length_s), _shades(span))


def _scale(curves: Sequence[Curve]) -> tuple[float, float]:
    """Return round ends of a scale with 0; it is symmetric unless next to nothing is below 0."""
    values = [curve.values for curve in curves]
    high, low = nice_above(_greatest(*values)), nice_above(_greatest(*(-array for array in values)))
    return (-0.2 * high, high) if low <= 0.2 * high else (-max(low, high), max(low, high))


def _health(cols: Columns, span: Span) -> Html:
    age_ms = cols.link_age_s * 1e3
    most_ms = nice_above(max(100.0, _greatest(age_ms)))
    charts = [strip("link age", span, [Curve("", "c-main", age_ms)], 0.0, most_ms, unit="ms")]
    known = cols.battery[np.isfinite(cols.battery)]
    note = "The robot reports no battery."
    if known.size:
        charts.append(strip("battery", span, [Curve("", "c-main", cols.battery * 100)], 0.0, 100.0, unit="%"))
        note = f"Battery: {known[0]:.0%} at the start, {known[-1]:.0%} at the end."
    return section("Link and battery", *charts, time_axis(span.length_s), tag("p", note, class_="faint"))


def _latency(cols: Columns, report: Report) -> Html:
    values = cols.latency_ms[np.isfinite(cols.latency_ms)]
    if not values.size:
        return section("Latency", tag("p", "No latency was logged.", class_="faint"))
    p50, p99, most = np.percentile(values, (50, 99, 100))
    edge = nice_above(min(float(most), 1.5 * float(p99)))
    counts, _ = np.histogram(values, HISTOGRAM_BARS, (0.0, edge))
    beyond = int((values > edge).sum())
    period_ms = cols.period_s * 1e3
    ends = tag("div", tag("span", "0 ms"), tag("span", f"{number(edge)} ms"), class_="ends")
    marks = {
        f"p50 {p50:.1f} ms": p50 / edge,
        f"p99 {p99:.1f} ms": p99 / edge,
        f"period {period_ms:.0f} ms": period_ms / edge,
    }
    text = f"{values.size} ticks. The longest took {most:.1f} ms."
    if beyond:
        text += f" {beyond} of {values.size} ticks took longer than is drawn."
    missed = report.summary["missed_deadlines"]
    text += f" {missed} deadlines were missed." if missed != 1 else " One deadline was missed."
    return section(
        "Latency from sensor to command",
        histogram("latency", counts.tolist(), marks),
        ends,
        tag("p", text),
        _stages(report),
    )


def _stages(report: Report) -> Html | None:
    """Return what each stage took; nothing of logs from before it was measured."""
    stages = report.summary["stages_ms"] | report.summary["far_ms"]
    rows = [
        (stage.replace("_", " "), words, *(figure(found, 1) for found in stages[stage].values()))
        for stage, words in (STAGES | FAR_STAGES).items()
        if stages[stage]["p50"] is not None
    ]
    return table(("stage", "what, in ms", "p50", "p99", "max"), rows) if len(rows) > 1 else None


def _greatest(*values: Floats) -> float:
    """Return the greatest of all values; 0 where there is none."""
    found = [float(np.nanmax(array)) for array in values if np.isfinite(array).any()]
    return max(found, default=0.0)
