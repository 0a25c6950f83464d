"""A trial as one image: evenly spaced camera frames above its curves over time."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import cv2
import numpy as np

from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.core.mask_png import PALETTE
from adatracker_deploy.core.messages import MaskClass
from adatracker_deploy.core.sight import Verdict
from adatracker_deploy.core.task import DESIRED_DISTANCE_M, box_reward
from adatracker_deploy.report.chart import BLUE, GAP_PX, GREY, INK, LEFT_PX, PAPER, Chart, text_px, write

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from adatracker_deploy.core.messages import Box, ClassMask
    from adatracker_deploy.core.record import StepRecord
    from adatracker_deploy.trial.reader import LoggedFrame, Trial

    Image = NDArray[np.uint8]
    Colour = tuple[int, int, int]

FRAME_PX = 220
"""Height of each frame."""
LABEL_PX = 30
CHART_PX = 84
"""Height of each chart."""
OVERLAY = 0.45
"""Opacity of the mask over a frame."""

LOST = (250, 222, 217)
STALE = (226, 229, 235)
RED = (200, 50, 40)
GREEN = PALETTE[MaskClass.TARGET]
UNSEEN = {verdict.value: verdict.words for verdict in Verdict if verdict is not Verdict.SEEN}


@dataclass(frozen=True, slots=True)
class Curve:
    """One chart: a value a step, None where there is none."""

    name: str
    values: Sequence[float | None]
    low: float
    high: float
    wanted: float
    """The desired value; drawn as a grey line."""


def film_strip(trial: Trial, frames: int = 8) -> Image:
    """Draw a trial as an RGB image of shape (H, W, 3), uint8.

    Args:
        trial: as it was read.
        frames: how many to show, evenly spaced over the steps whose frames are in the log.

    Raises:
        UsageError: the log has no steps, or no frames for them.
    """
    shown = _evenly_spaced([step for step in trial.steps if step.frame_seq in trial.frame_seqs], frames)
    logged = {frame.seq: frame for frame in trial.frames({step.frame_seq for step in shown})}
    pairs = [(step, logged[step.frame_seq]) for step in shown if step.frame_seq in logged]
    if not pairs:
        raise UsageError(f"{trial.path}: no camera frames in it, so there is no film strip to make")
    began_ns = trial.steps[0].t_ns
    pictures = [_picture(step, frame, (step.t_ns - began_ns) / 1e9) for step, frame in pairs]
    strip = np.hstack([_padded(picture, GAP_PX) for picture in pictures])
    curves = _curves(trial.steps)
    width = max(strip.shape[1], 3 * LEFT_PX) + LEFT_PX
    height = LABEL_PX + strip.shape[0] + len(curves) * (CHART_PX + GAP_PX) + LABEL_PX
    canvas = np.full((height, width, 3), PAPER, np.uint8)
    write(canvas, _title(trial), (LEFT_PX, LABEL_PX - 9), INK, 0.6)
    canvas[LABEL_PX : LABEL_PX + strip.shape[0], LEFT_PX : LEFT_PX + strip.shape[1]] = strip
    times_s = [(step.t_ns - began_ns) / 1e9 for step in trial.steps]
    shades = [_shade(step) for step in trial.steps]
    top = LABEL_PX + strip.shape[0]
    for curve in curves:
        _chart(canvas[top : top + CHART_PX], curve, times_s, shades)
        top += CHART_PX + GAP_PX
    _time_axis(canvas, top, times_s[-1], stale=STALE in shades)
    return canvas


def _evenly_spaced(steps: Sequence[StepRecord], count: int) -> list[StepRecord]:
    if not steps:
        return []
    places = np.linspace(0, len(steps) - 1, min(count, len(steps)))
    return [steps[round(place)] for place in places]


def _title(trial: Trial) -> str:
    outcome = trial.summary["outcome"] if trial.summary else "cut short"
    return f"{trial.platform} ({trial.kind}), policy {trial.policy}: {outcome}, {len(trial.steps) - 1} steps"


def _curves(steps: Sequence[StepRecord]) -> list[Curve]:
    reference = next((step.box for step in steps if step.box is not None), None)

    def reward(step: StepRecord) -> float | None:
        if step.stale:
            return None
        return box_reward(step.box, reference) if step.box and reference else 0.0

    curves = [Curve("R (box)", [reward(step) for step in steps], 0.0, 1.0, wanted=1.0)]
    if any(step.distance_m is not None for step in steps):
        bearings = [None if step.bearing_rad is None else math.degrees(step.bearing_rad) for step in steps]
        curves += [
            Curve("distance, m", [step.distance_m for step in steps], 0.0, 7.5, wanted=DESIRED_DISTANCE_M),
            Curve("bearing, deg", bearings, -45.0, 45.0, wanted=0.0),
        ]
    return curves


def _picture(step: StepRecord, frame: LoggedFrame, time_s: float) -> Image:
    """Draw one frame with its mask painted over, its box, and a line of text below."""
    height, width = frame.rgb.shape[:2]
    size = (max(1, round(width * FRAME_PX / height)), FRAME_PX)
    image = cv2.resize(
        frame.rgb, size, interpolation=cv2.INTER_AREA if height > FRAME_PX else cv2.INTER_CUBIC
    )
    image = _painted(image, cv2.resize(frame.mask, size, interpolation=cv2.INTER_NEAREST))
    if step.true_box is not None:
        _outline(image, step.true_box, BLUE, thick=1)
    if step.box is not None:
        _outline(image, step.box, GREEN)
    label = np.full((LABEL_PX, size[0], 3), PAPER, np.uint8)
    write(label, f"{time_s:.1f} s", (2, 20), INK, 0.55)
    words, colour, scale = _verdict(step)
    write(label, words, (size[0] - text_px(words, scale) - 2, 20), colour, scale)
    return np.vstack([image, label])


def _verdict(step: StepRecord) -> tuple[str, Colour, float]:
    """Return what a frame's label says of it, its colour and its size."""
    if step.stale:
        return "stale", GREY, 0.55
    if step.sight in UNSEEN:
        return UNSEEN[step.sight], RED, 0.45
    if step.box is None:
        return "lost", RED, 0.55
    return "" if step.distance_m is None else f"{step.distance_m:.1f} m", INK, 0.55


def _painted(image: Image, mask: ClassMask) -> Image:
    colours = np.array(PALETTE, np.uint8)[np.minimum(mask, len(PALETTE) - 1)]
    mixed = cv2.addWeighted(image, 1 - OVERLAY, colours, OVERLAY, 0)
    people = np.isin(mask, (MaskClass.TARGET, MaskClass.PERSON))
    return np.where(people[..., None], mixed, image)


def _outline(image: Image, box: Box, colour: Colour, thick: int = 2) -> None:
    height, width = image.shape[:2]
    corners = [
        (round((box.cx + side * box.w / 2) * width), round((box.cy + side * box.h / 2) * height))
        for side in (-1, 1)
    ]
    cv2.rectangle(image, corners[0], corners[1], colour, thick, cv2.LINE_AA)


def _padded(image: Image, gap_px: int) -> Image:
    return np.pad(image, ((0, 0), (0, gap_px), (0, 0)), constant_values=PAPER[0])


def _shade(step: StepRecord) -> Colour | None:
    if step.stale:
        return STALE
    return LOST if step.box is None else None


def _chart(area: Image, curve: Curve, times_s: Sequence[float], shades: Sequence[Colour | None]) -> None:
    """Draw a curve into a strip as wide as the picture; lost and stale stretches are shaded."""
    chart = Chart(area, times_s[-1], curve.low, curve.high)
    for before_s, now_s, colour in zip(times_s, times_s[1:], shades[1:], strict=False):
        if colour:
            chart.shade(before_s, now_s, colour)
    chart.frame(curve.name, curve.wanted)
    chart.curve(times_s, curve.values, BLUE)


def _time_axis(canvas: Image, top: int, duration_s: float, *, stale: bool) -> None:
    write(canvas, "0 s", (LEFT_PX, top + 8), GREY, 0.55)
    write(canvas, f"{duration_s:.1f} s", (canvas.shape[1] - GAP_PX - 64, top + 8), GREY, 0.55)
    if canvas.shape[1] > 6 * LEFT_PX:
        words = "shaded: target lost" + ("; grey: frame too old to act on" if stale else "")
        write(canvas, words, (canvas.shape[1] // 2 - 40, top + 8), GREY, 0.55)
