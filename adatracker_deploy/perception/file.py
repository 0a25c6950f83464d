"""A video file as a camera."""

from __future__ import annotations

from typing import TYPE_CHECKING

from adatracker_deploy.perception.capture import Capture
from adatracker_deploy.perception.film import FilmCamera

if TYPE_CHECKING:
    from pathlib import Path


class FileCamera(FilmCamera):
    """Plays a video file; `every_frame` as in `FilmCamera`."""

    def __init__(self, path: Path, *, every_frame: bool = False) -> None:
        super().__init__(str(path), every_frame=every_frame)
        self._path = path

    def _open_film(self) -> Capture:
        return Capture(str(self._path))
