"""Video input through OpenCV; its output to stderr is suppressed, and errors are raised instead."""

from __future__ import annotations

import math
import os
from typing import TYPE_CHECKING

import cv2
import numpy as np

from adatracker_deploy.core.camera import check_size

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

_FFMPEG_QUIET = "-8"
"""AV_LOG_QUIET. OpenCV reads it from the environment when it first uses FFmpeg."""


def has_gstreamer() -> bool:
    """Return whether this build of OpenCV can run GStreamer pipelines; the one from PyPI cannot."""
    return bool(cv2.videoio_registry.hasBackend(cv2.CAP_GSTREAMER))


def keep_quiet() -> None:
    """Keep OpenCV and FFmpeg from writing errors to stderr that are raised anyway."""
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", _FFMPEG_QUIET)
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)


class Capture:
    """An open video, read frame by frame.

    Args:
        target: a path, an address or a pipeline.
        backend: one of OpenCV's ``CAP_`` backends.
        settings: pairs of ``CAP_PROP_`` and value that hold from the start.

    Raises:
        ValueError: it cannot be opened, or its pictures are larger than may be decoded.
    """

    def __init__(self, target: str, backend: int = cv2.CAP_FFMPEG, settings: Sequence[int] = ()) -> None:
        keep_quiet()
        self._capture = cv2.VideoCapture(target, backend, list(settings))
        if not self._capture.isOpened():
            raise ValueError("cannot be opened as a video")
        width, height = (
            int(self._get(side)) for side in (cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT)
        )
        try:
            check_size(max(1, width), max(1, height))  # 0: a stream that states its size with its first frame
        except ValueError:
            self.close()
            raise

    @property
    def rate_hz(self) -> float:
        """The frame rate that the video states, Hz; 0 or arbitrary if it is unknown."""
        return self._get(cv2.CAP_PROP_FPS)

    @property
    def at_ns(self) -> int:
        """Capture time of the grabbed frame, as stated by the stream; 0 if it states none."""
        at_ms = self._get(cv2.CAP_PROP_POS_MSEC)
        return round(at_ms * 1e6) if 0 < at_ms < math.inf else 0

    def grab(self) -> bool:
        """Advance to the next frame; False if there is none, for any reason."""
        return bool(self._capture.grab())

    def rgb(self) -> NDArray[np.uint8]:
        """Return the grabbed frame, shape (H, W, 3).

        Raises:
            ValueError: it cannot be decoded, or is too large.
        """
        decoded, bgr = self._capture.retrieve()
        if not decoded or bgr is None or bgr.ndim != 3 or bgr.shape[2] != 3:
            raise ValueError("a frame cannot be decoded to colours")
        check_size(bgr.shape[1], bgr.shape[0])
        return np.asarray(cv2.cvtColor(bgr, cv2.COLOR_BGR2RGB), np.uint8)

    def close(self) -> None:
        """Close the device or file."""
        self._capture.release()

    def _get(self, what: int) -> float:
        return float(self._capture.get(what))
