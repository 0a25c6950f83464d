"""Video output through OpenCV: writes images to an MP4 of constant frame rate."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING

import cv2

from adatracker_deploy.core.errors import PlatformError, UsageError
from adatracker_deploy.perception.capture import Capture, keep_quiet

if TYPE_CHECKING:
    from pathlib import Path

    import numpy as np
    from numpy.typing import NDArray

SUFFIX = ".mp4"
_CODEC = "vp09"
"""VP9: what every browser plays, and the FFmpeg in OpenCV's own wheels writes (H.264 and AV1 it does not)."""


def check_film_path(path: Path) -> None:
    """Check that a video can be written to a path; leaves nothing behind.

    Raises:
        UsageError: it could not.
    """
    if path.suffix.lower() != SUFFIX:
        raise UsageError(f"{path}: expected a file name that ends in {SUFFIX}")
    if not path.absolute().parent.is_dir():
        raise UsageError(f"{path}: there is no folder {path.parent}")
    if path.is_dir() or not os.access(path if path.exists() else path.absolute().parent, os.W_OK):
        raise UsageError(f"{path}: cannot be written")


class FilmWriter:
    """Writes images of one size; each is shown until the next one's time.

    Args:
        path: ends in ``.mp4``; what is there is replaced.
        rate_hz: frames a second.
    """

    def __init__(self, path: Path, rate_hz: float) -> None:
        self._path = path
        self._rate_hz = rate_hz
        self._writer: cv2.VideoWriter | None = None
        self._began_ns = 0
        self._last: NDArray[np.uint8] | None = None
        self._size = (0, 0)
        self.frames = 0
        """Written so far."""

    def write(self, rgb: NDArray[np.uint8], t_ns: int) -> None:
        """Write an image, shape (H, W, 3), at its time; one that comes too early is skipped.

        Raises:
            UsageError: no film can be written there.
            PlatformError: the picture's size is another than the first one's.
        """
        if self._writer is None:
            self._began_ns, self._size = t_ns, (rgb.shape[1], rgb.shape[0])
            self._writer = cv2.VideoWriter()  # known to `close` before it is open: somebody may interrupt
            self._open(self._writer)
        if (rgb.shape[1], rgb.shape[0]) != self._size:
            raise PlatformError(f"film {self._path}: a picture of another size")
        turn = round((t_ns - self._began_ns) / 1e9 * self._rate_hz)
        bgr = cv2.cvtColor(rgb, cv2.COLOR_RGB2BGR)
        while self.frames < turn and self._last is not None:
            self._put(self._writer, self._last)
        if self.frames == turn:
            self._put(self._writer, bgr)
        self._last = bgr

    def close(self) -> None:
        """Finish the video and check that it can be read; may be called twice, and without any image.

        Raises:
            PlatformError: it cannot.
        """
        writer, self._writer = self._writer, None
        if writer is None:
            return
        writer.release()
        if not self.frames:
            self._path.unlink(missing_ok=True)
            return
        try:
            film = Capture(str(self._path))
            whole = film.grab()
            film.close()
        except ValueError:
            whole = False
        if not whole:
            raise PlatformError(f"film {self._path}: the written film cannot be read: is the disk full?")

    def _open(self, writer: cv2.VideoWriter) -> None:
        keep_quiet()
        code = cv2.VideoWriter.fourcc(*_CODEC)
        if not writer.open(str(self._path), cv2.CAP_FFMPEG, code, self._rate_hz, self._size):
            self._writer = None  # what is there is not ours
            raise UsageError(f"film {self._path}: OpenCV cannot write an MP4 (VP9) there")

    def _put(self, writer: cv2.VideoWriter, bgr: NDArray[np.uint8]) -> None:
        writer.write(bgr)
        self.frames += 1
