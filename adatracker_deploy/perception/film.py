"""Plays a recording as a camera, at its own rate or frame by frame; deterministic."""

from __future__ import annotations

import abc
from typing import TYPE_CHECKING, Protocol

from adatracker_deploy.core.camera import FilmOverError
from adatracker_deploy.core.errors import PlatformError, UsageError
from adatracker_deploy.core.messages import Frame
from adatracker_deploy.perception.frame_monitor import FrameMonitor

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

SLOWEST_HZ, FASTEST_HZ = 1.0, 240.0
_USUAL_HZ = 25.0
"""Frame rate for a recording that states none, or an implausible one."""


class Film(Protocol):
    """A recording that is read once, in order."""

    @property
    def rate_hz(self) -> float:
        """The stated frame rate, Hz; 0 or arbitrary if it is unknown."""

    def grab(self) -> bool:
        """Advance to the next frame; False if there is none."""

    def rgb(self) -> NDArray[np.uint8]:
        """Return the current frame, shape (H, W, 3).

        Raises:
            ValueError: it is damaged, or too large.
        """

    def close(self) -> None:
        """Close the recording."""


class FilmCamera(abc.ABC):
    """Plays a recording once, from the first `read`; decodes in the reading thread.

    Args:
        name: how errors name the camera.
        every_frame: each `read` gives the next frame, stamped with that moment; by default the recording
            plays at its own rate, and frames not read in time are skipped.
    """

    def __init__(self, name: str, *, every_frame: bool = False) -> None:
        self.name = name
        self.rate_hz = _USUAL_HZ
        """The recording's stated rate; known once it is open."""
        self._every_frame = every_frame
        self._watch = FrameMonitor(name)
        self._film: Film | None = None
        self._began_ns: int | None = None
        self._at = 0
        """Number of frames read so far; the newest frame's number."""
        self._newest: Frame | None = None

    @abc.abstractmethod
    def _open_film(self) -> Film:
        """Open the recording.

        Raises:
            ValueError: it cannot be played.
        """

    def open(self) -> None:
        """Open the recording and check that it has a first frame.

        Raises:
            UsageError: it cannot be played.
        """
        try:
            self._film = self._open_film()
            if not self._film.grab():
                raise ValueError("has no frames")
            self._at = 1
            self._film.rgb()
        except ValueError as error:
            raise UsageError(f"camera {self.name}: {error}") from error
        stated_hz = self._film.rate_hz
        self.rate_hz = stated_hz if SLOWEST_HZ <= stated_hz <= FASTEST_HZ else _USUAL_HZ

    def read(self, now_ns: int) -> Frame | None:
        """Return the frame that is due at `now_ns`; None before `open`.

        Raises:
            FilmOverError: the recording has ended.
            PlatformError: it is damaged or changes its size.
        """
        if self._film is None:
            return None
        if self._began_ns is None:
            self._began_ns = now_ns
        if self._every_frame:
            due, t_ns = (self._newest.seq + 1 if self._newest else 1), now_ns
        else:
            period_ns = round(1e9 / self.rate_hz)
            index = (now_ns - self._began_ns) // period_ns
            due, t_ns = index + 1, self._began_ns + index * period_ns
        if self._newest is None or due > self._newest.seq:
            self._newest = self._frame(self._film, due, t_ns)
            self._watch.accept(self._newest, t_ns)
        return self._newest

    def go(self) -> None:  # noqa: B027 -- all that a film can do
        """Do nothing: the recording starts with the first `read`."""

    def close(self) -> None:
        """Close the recording."""
        film, self._film = self._film, None
        if film is not None:
            film.close()

    def _frame(self, film: Film, number: int, t_ns: int) -> Frame:
        while self._at < number:
            if not film.grab():
                raise FilmOverError(f"camera {self.name}: the video has ended after {self._at} frames")
            self._at += 1
        try:
            return Frame(film.rgb(), t_ns, number)
        except ValueError as error:
            raise PlatformError(f"camera {self.name}: frame {number}: {error}") from error
