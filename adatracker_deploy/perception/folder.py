"""Plays a folder of images as a camera, in natural order of their names."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from adatracker_deploy.perception.film import FilmCamera
from adatracker_deploy.perception.image import decode_image

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    import numpy as np
    from numpy.typing import NDArray

USUAL_HZ = 10.0
"""Default frame rate; many robot data sets have it, and images state none."""
LARGEST_FILE_BYTES = 256 << 20
"""An 8192x8192 PNG of pure noise has 200 MB."""
_KINDS = (".png", ".jpg", ".jpeg")
_NUMBER = re.compile(r"([0-9]+)")


def pictures_in(folder: Path) -> list[Path]:
    """Return the PNG and JPEG files of a folder, 2 before 10; hidden ones and other files are left out.

    Raises:
        ValueError: the folder cannot be read, or there are none.
    """
    try:
        found = [
            path
            for path in folder.iterdir()
            if path.suffix.lower() in _KINDS and not path.name.startswith(".") and path.is_file()
        ]
    except OSError as error:
        raise ValueError(f"cannot be read ({error.strerror})") from error
    if not found:
        raise ValueError("a folder without PNG or JPEG pictures")
    return sorted(found, key=lambda path: natural(path.name))


def natural(name: str) -> tuple[list[str | int], str]:
    """Return a sort key in which numbers within names count as numbers; 7 comes before 07."""
    parts = _NUMBER.split(name.lower())
    return [int(part) if place % 2 else part for place, part in enumerate(parts)], name


class FolderCamera(FilmCamera):
    """Plays a folder's pictures; `every_frame` as in `FilmCamera`.

    Args:
        folder: with a picture a frame, all of one size.
        rate_hz: pictures a second.
        every_frame: see there.
    """

    def __init__(self, folder: Path, *, rate_hz: float = USUAL_HZ, every_frame: bool = False) -> None:
        super().__init__(str(folder), every_frame=every_frame)
        self._folder = folder
        self._stated_hz = rate_hz

    def _open_film(self) -> _Pictures:
        return _Pictures(pictures_in(self._folder), self._stated_hz)


class _Pictures:
    """Implements `Film`: one file per frame, read on demand."""

    def __init__(self, paths: Sequence[Path], rate_hz: float) -> None:
        self.rate_hz = rate_hz
        self._paths = paths
        self._at = -1

    def grab(self) -> bool:
        self._at += 1
        return self._at < len(self._paths)

    def rgb(self) -> NDArray[np.uint8]:
        path = self._paths[self._at]
        try:
            if path.stat().st_size > LARGEST_FILE_BYTES:
                raise ValueError(f"more than {LARGEST_FILE_BYTES >> 20} MiB")
            return decode_image(path.read_bytes())
        except OSError as error:
            raise ValueError(f"{path.name}: cannot be read ({error.strerror})") from error
        except ValueError as error:
            raise ValueError(f"{path.name}: {error}") from error

    def close(self) -> None:
        """Do nothing: no file stays open."""
