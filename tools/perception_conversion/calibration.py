"""Pictures by which quantisation learns how large activations are."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.perception.capture import Capture

Floats = NDArray[np.float32]

MEAN_BGR = (103.53, 116.28, 123.675)
STD_BGR = (57.375, 57.12, 58.395)
"""NanoDet's normalisation in training, for pictures of 0 to 255."""
STRIDE = 32
"""Width and height are a multiple of it."""

_VIDEOS = (".avi", ".mkv", ".mov", ".mp4")
_WIDTHS = (416, 320)
_BRIGHTNESS = (0.6, 1.0, 1.4)


def videos_in(places: Sequence[Path]) -> list[Path]:
    """Return the files among `places` and the videos in its folders, by name.

    Raises:
        UsageError: a place that is not there, or a folder without videos.
    """
    found: list[Path] = []
    for place in places:
        files = [place] if place.is_file() else sorted(p for p in place.glob("*") if p.suffix in _VIDEOS)
        if not files:
            raise UsageError(f"{place}: there is no video to calibrate on")
        found += files
    return found


def calibration_inputs(videos: Sequence[Path], per_video: int) -> Iterator[Floats]:
    """Give model inputs from `per_video` pictures of each video, spread over it.

    Pictures take turns in width, in being mirrored and in brightness, so that the ranges are not those of one
    camera's exposure.

    Raises:
        UsageError: a video that cannot be read.
    """
    for video in videos:
        for turn, picture in enumerate(_spread(video, per_video)):
            mirrored = picture[:, ::-1] if turn % 2 else picture
            lit = np.clip(mirrored * np.float32(_BRIGHTNESS[turn % len(_BRIGHTNESS)]), 0, 255)
            yield nanodet_input(lit, _WIDTHS[turn // 2 % len(_WIDTHS)])


def nanodet_input(bgr: NDArray[Any], width: int) -> Floats:
    """Return a picture (H, W, 3) as NanoDet takes it: `width` wide, black below up to a multiple of 32."""
    height = max(round(bgr.shape[0] * width / bgr.shape[1]), 1)
    scaled = cv2.resize(bgr.astype(np.float32), (width, height), interpolation=cv2.INTER_LINEAR)
    padded = np.pad(scaled, ((0, -height % STRIDE), (0, 0), (0, 0)))
    normal = (padded - np.array(MEAN_BGR, np.float32)) / np.array(STD_BGR, np.float32)
    return np.ascontiguousarray(normal.transpose(2, 0, 1)[None])


def _spread(video: Path, count: int) -> Iterator[NDArray[Any]]:
    """Yield `count` pictures, BGR, evenly from the video's beginning to its end."""
    try:
        total = _length(video)
        capture = Capture(str(video))
    except ValueError as error:
        raise UsageError(f"{video}: no picture can be read from it: {error}") from error
    if not total:
        raise UsageError(f"{video}: no picture can be read from it")
    wanted = {round(place) for place in np.linspace(0, total - 1, count)}
    for index in range(total):
        capture.grab()
        if index in wanted:
            yield capture.rgb()[:, :, ::-1]
    capture.close()


def _length(video: Path) -> int:
    """Count the frames; what a file says of itself may be wrong."""
    capture = Capture(str(video))
    frames = 0
    while capture.grab():
        frames += 1
    capture.close()
    return frames
