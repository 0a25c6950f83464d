"""Charts as inline SVG that stretches to any width; their text is HTML, so that it never shrinks.

A plot is 1000 wide and 100 high in its own units. Only curves, bars and shading are inside it.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from adatracker_deploy.report.markup import Html, join, tag

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from adatracker_deploy.report.columns import Floats, Interval


def envelope(values: NDArray[np.float64], columns: int) -> NDArray[np.intp]:
    """Return the indices of the points to draw, ascending; all of them when there are few.

    The values are cut into `columns` stretches of equal length. Of each its least and greatest stay, so that
    no spike is lost, and its first NaN, so that no gap is bridged; besides these the first and the last value
    of all. See U. Jugel et al., "M4: A Visualization-Oriented Time Series Data Aggregation", 2014.

    Args:
        values: shape (T,); NaN where there is none.
        columns: at least 1.
    """
    count = len(values)
    if count <= 3 * columns:
        return np.arange(count)
    edges = np.linspace(0, count, columns + 1).astype(np.intp)
    kept = [0, count - 1]
    missing = np.isnan(values)
    least, greatest = np.where(missing, np.inf, values), np.where(missing, -np.inf, values)
    for start, end in itertools.pairwise(edges):
        kept += [start + int(least[start:end].argmin()), start + int(greatest[start:end].argmax())]
        gap = int(missing[start:end].argmax())
        if missing[start + gap]:
            kept.append(start + gap)
    return np.unique(np.array(kept, np.intp))


WIDTH, HEIGHT = 1000.0, 100.0
COLUMNS = 600
"""Number of columns to which a long curve is reduced: about a pixel each on a large screen."""
_LEAST_WIDTH = 1.0
"""Nothing that happened is narrower."""
_NICE = (1.0, 1.5, 2.0, 3.0, 5.0, 10.0)
_TIME_STEPS_S = (0.5, 1, 2, 5, 10, 20, 30, 60, 120, 300, 600, 1200, 1800, 3600)


@dataclass(frozen=True, slots=True)
class Curve:
    """One line of a chart."""

    name: str
    look: str
    """Its class in the style sheet."""
    values: Floats
    """One a step; NaN where there is none."""


@dataclass(frozen=True, slots=True)
class Band:
    """The intervals in which something held."""

    name: str
    look: str
    stretches: Sequence[Interval]
    rare: bool = False
    """Drawn wide enough to be seen however short it was."""


@dataclass(frozen=True, slots=True)
class Stairs:
    """One line that falls in steps."""

    look: str
    corners: Sequence[tuple[float, float]]
    """From where on it has which height."""
    end: float
    """The right end of what is known."""


@dataclass(frozen=True, slots=True)
class Span:
    """The time that charts show, from 0 to its length, s, and what is shaded in all of them."""

    times_s: Floats
    length_s: float
    lost: Sequence[Interval]
    stopped: Sequence[Interval]


def strip(
    name: str,
    span: Span,
    curves: Sequence[Curve],
    low: float,
    high: float,
    *,
    wanted: float | None = None,
    unit: str = "",
) -> Html:
    """Draw curves over time.

    Args:
        name: of the quantity.
        span: what the others of the page show as well.
        curves: at least one; those of several are named below it.
        low: at the lower edge.
        high: at the upper edge, above `low`.
        wanted: where the value would best be.
        unit: of the values.
    """
    inside = [*_shading(span)]
    if wanted is not None:
        inside.append(tag("path", d=f"M0 {_y(wanted, low, high):.1f}H{WIDTH:g}", class_="wanted"))
    inside += [tag("path", d=_line(curve.values, span, low, high), class_=curve.look) for curve in curves]
    keys = [key(curve.name, curve.look) for curve in curves] if len(curves) > 1 else []
    return _row(name, unit, _plot(name, *inside), (number(high), number(low)), *keys)


def lane(name: str, span: Span, bands: Sequence[Band]) -> Html:
    """Draw what held when as one row, later bands over earlier ones; those that never held are left out."""
    held = [band for band in bands if band.stretches]
    drawn = [
        tag(
            "path",
            d=bars(band.stretches, span.length_s, _LEAST_WIDTH if band.rare else 0.0),
            class_=band.look,
        )
        for band in held
    ]
    return _row(
        name, "", _plot(name, *drawn, class_="lane"), None, *(key(band.name, band.look) for band in held)
    )


def time_axis(length_s: float) -> Html:
    """Write the times below a column of charts."""
    step_s = next((step for step in _TIME_STEPS_S if length_s / step <= 6), length_s / 6)
    times = np.arange(0, length_s * 0.97, step_s)
    labels = [tag("span", clock(time_s), style=f"left:{100 * time_s / length_s:.2f}%") for time_s in times]
    return tag("div", tag("div", *labels, class_="axis"), class_="row last", aria_hidden="true")


def histogram(name: str, counts: Sequence[int], marks: Mapping[str, float]) -> Html:
    """Draw bars of equal width; marks, from 0 to 1 along the axis, are lines with their names."""
    highest = max(counts, default=0) or 1
    wide = WIDTH / max(1, len(counts))
    tall = [count / highest * (HEIGHT - 4) for count in counts]
    path = "".join(
        f"M{place * wide:.1f} {HEIGHT:g}v{-height:.1f}h{wide * 0.9:.1f}v{height:.1f}z"
        for place, height in enumerate(tall)
        if height
    )
    inside = {mark: at for mark, at in marks.items() if 0 <= at <= 1}
    lines = [tag("path", d=f"M{WIDTH * at:.1f} 0V{HEIGHT:g}", class_="mark") for at in inside.values()]
    labels = [
        tag(
            "span",
            mark,
            class_="left" if at > 0.7 else None,
            style=f"left:{100 * at:.2f}%;top:{1.2 * row}rem",
        )
        for row, (mark, at) in enumerate(inside.items())
    ]
    plot = _plot(name, tag("path", d=path, class_="bars"), *lines, class_="tall")
    return tag("div", plot, *labels, class_="marked")


def stairs(name: str, curves: Sequence[Stairs], last: float, unit: str, keys: Sequence[Html]) -> Html:
    """Draw stairs that fall from 1 at the left; `last` is the right edge, in `unit`."""
    drawn = [tag("path", d=f"M0 {HEIGHT / 2:g}H{WIDTH:g}", class_="wanted")]
    for stair in curves:
        path = "".join(
            f"{'H' if place else 'M'}{WIDTH * at / last:.1f}{'V' if place else ' '}{_y(share, 0, 1):.1f}"
            for place, (at, share) in enumerate(stair.corners)
        )
        drawn.append(tag("path", d=f"{path}H{WIDTH * stair.end / last:.1f}", class_=stair.look))
    ends = tag("div", tag("span", "0"), tag("span", f"{number(last)} {unit}"), class_="ends")
    return _row(name, "", join((_plot(name, *drawn, class_="tall"), ends)), ("1", "0"), *keys)


def sparkline(times_s: Floats, values: Floats, length_s: float) -> Html:
    """Draw one curve from 0 to 1, without words."""
    span = Span(times_s, length_s, (), ())
    return _plot("R over time", tag("path", d=_line(values, span, 0.0, 1.0), class_="c-main"))


def bars(
    stretches: Sequence[Interval],
    length_s: float,
    least_width: float = _LEAST_WIDTH,
    top: float = 0.0,
    bottom: float = HEIGHT,
) -> str:
    """Return stretches of time as the path of upright bars, those that would touch as one."""
    merged: list[list[float]] = []
    for stretch in stretches:
        start, end = (WIDTH * time_s / length_s for time_s in stretch)
        end = max(end, start + least_width)
        if merged and start - merged[-1][1] <= least_width / 2:
            merged[-1][1] = max(end, merged[-1][1])
        else:
            merged.append([start, end])
    tall = bottom - top
    return "".join(
        f"M{start:.2f} {top:g}h{end - start:.2f}v{tall:g}h{start - end:.2f}z" for start, end in merged
    )


def key(name: str, look: str) -> Html:
    """Name a look."""
    return tag("span", tag("i", class_=look), name, class_="key")


def nice_above(value: float) -> float:
    """Return a round number that is not below a value; 1 for what is not above 0."""
    if not value > 0 or not math.isfinite(value):
        return 1.0
    scale = 10.0 ** math.floor(math.log10(value))
    return next(nice * scale for nice in (*_NICE, 20.0) if nice * scale >= value * (1 - 1e-9))


def number(value: float) -> str:
    """Write a number of a scale."""
    return f"{value:.4g}"


def clock(time_s: float) -> str:
    """Write a time: seconds below two minutes' worth of them, else minutes and seconds."""
    if time_s < 100:
        return f"{time_s:g} s"
    minutes, seconds = divmod(round(time_s), 60)
    return f"{minutes}:{seconds:02d}"


def _row(name: str, unit: str, plot: Html, scale: tuple[str, str] | None, *keys: Html) -> Html:
    label = tag("div", name, tag("small", unit) if unit else None, class_="label")
    ends = [tag("span", text) for text in scale] if scale else []
    below = tag("div", *keys, class_="keys") if keys else None
    return tag("div", label, tag("div", *ends, class_="scale"), plot, below, class_="row")


def _plot(name: str, *inside: Html, class_: str | None = None) -> Html:
    return tag(
        "svg",
        *inside,
        viewBox=f"0 0 {WIDTH:g} {HEIGHT:g}",
        preserveAspectRatio="none",
        role="img",
        aria_label=name,
        class_=class_,
    )


def _shading(span: Span) -> list[Html]:
    """Shade the whole height; what is stopped has a solid edge as well, to be told apart without colours."""
    shaded = []
    if span.lost:
        shaded.append(tag("path", d=bars(span.lost, span.length_s), class_="lost"))
    if span.stopped:
        shaded.append(tag("path", d=bars(span.stopped, span.length_s), class_="stopped"))
        shaded.append(tag("path", d=bars(span.stopped, span.length_s, bottom=8.0), class_="stopped-edge"))
    return shaded


def _line(values: Floats, span: Span, low: float, high: float) -> str:
    """Return the path of a curve: broken where there is no value, a dot where there is only one."""
    kept = envelope(values, COLUMNS)
    points = [
        None if math.isnan(value) else f"{WIDTH * time_s / span.length_s:.1f} {_y(value, low, high):.1f}"
        for time_s, value in zip(span.times_s[kept], values[kept], strict=True)
    ]
    runs = (list(run) for seen, run in itertools.groupby(points, lambda point: point is not None) if seen)
    return "".join("M" + "L".join(map(str, run)) + ("h0" if len(run) == 1 else "") for run in runs)


def _y(value: float, low: float, high: float) -> float:
    """Return the height of a value, 1 from either edge; a line on the edge itself would be cut in half."""
    share = (min(max(value, low), high) - low) / (high - low)
    return float(1 + (1 - share) * (HEIGHT - 2))
