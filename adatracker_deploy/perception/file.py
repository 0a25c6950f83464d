"""A video file as a camera: at its own rate in the run's time, or frame by frame; the same every time."""

from __future__ import annotations

from typing import TYPE_CHECKING

from adatracker_deploy.errors import PlatformError, UsageError
from adatracker_deploy.messages import Frame
from adatracker_deploy.perception.camera import FilmOverError
from adatracker_deploy.perception.capture import Capture
from adatracker_deploy.perception.watch import FrameWatch

if TYPE_CHECKING:
    from pathlib import Path

_SLOWEST_HZ, _FASTEST_HZ = 1.0, 240.0
_USUAL_HZ = 25.0
"""For a file that states no rate, or none in between."""


class FileCamera:
    """Plays a video file once, beginning with the first `read`; it is decoded in the thread that reads.

    Args:
        path: the file.
        every_frame: each `read` gives the next frame, taken at that moment; by default the file plays at its
            own rate, and frames that nobody was in time for are skipped.
    """

    def __init__(self, path: Path, *, every_frame: bool = False) -> None:
        self._path = path
        self._every_frame = every_frame
        self._watch = FrameWatch(str(path))
        self._capture: Capture | None = None
        self._period_ns = 0
        self._began_ns: int | None = None
        self._at = 0
        """How many frames have been gone on to; the newest frame's number."""
        self._newest: Frame | None = None

    def open(self) -> None:
        """Open the file and see that it has a first frame.

        Raises:
            UsageError: it is no video that can be played.
        """
        try:
            self._capture = Capture(str(self._path))
            if not self._capture.grab():
                raise ValueError("has no frames")
            self._at = 1
            self._capture.rgb()
        except ValueError as error:
            raise UsageError(f"camera {self._path}: {error}") from error
        stated_hz = self._capture.rate_hz
        rate_hz = stated_hz if _SLOWEST_HZ <= stated_hz <= _FASTEST_HZ else _USUAL_HZ
        self._period_ns = round(1e9 / rate_hz)

    def read(self, now_ns: int) -> Frame | None:
        """Return the frame that is due at `now_ns`; None before `open`.

        Raises:
            FilmOverError: the video has ended.
            PlatformError: it is damaged or changes its size.
        """
        if self._capture is None:
            return None
        if self._began_ns is None:
            self._began_ns = now_ns
        if self._every_frame:
            due, t_ns = (self._newest.seq + 1 if self._newest else 1), now_ns
        else:
            index = (now_ns - self._began_ns) // self._period_ns
            due, t_ns = index + 1, self._began_ns + index * self._period_ns
        if self._newest is None or due > self._newest.seq:
            self._newest = self._frame(self._capture, due, t_ns)
            self._watch.accept(self._newest)
        return self._newest

    def go(self) -> None:
        """Do nothing: what is filmed has happened."""

    def close(self) -> None:
        """Close the file."""
        capture, self._capture = self._capture, None
        if capture is not None:
            capture.close()

    def _frame(self, capture: Capture, number: int, t_ns: int) -> Frame:
        while self._at < number:
            if not capture.grab():
                raise FilmOverError(f"camera {self._path}: the video has ended after {self._at} frames")
            self._at += 1
        try:
            return Frame(capture.rgb(), t_ns, number)
        except ValueError as error:
            raise PlatformError(f"camera {self._path}: frame {number}: {error}") from error
