"""Figure output with matplotlib, which is in the train extra."""

from __future__ import annotations

import importlib.util
from typing import TYPE_CHECKING

from adatracker_deploy.core.errors import UsageError

if TYPE_CHECKING:
    from pathlib import Path

    from matplotlib.figure import Figure


def check_drawing(path: Path) -> None:
    """Tell now, before hours of work, whether a picture can be written there.

    Raises:
        UsageError: matplotlib is not installed, the folder is not there, or the ending is not .png.
    """
    if importlib.util.find_spec("matplotlib") is None:
        raise UsageError("pictures need matplotlib: pip install 'adatracker-deploy[train]'")
    if path.suffix != ".png":
        raise UsageError(f"{path}: name a picture that ends in .png")
    if not path.parent.is_dir():
        raise UsageError(f"{path}: there is no folder {path.parent}")


def write_figure(figure: Figure, path: Path) -> None:
    """Write a PNG.

    Raises:
        UsageError: it cannot be written.
    """
    try:
        figure.savefig(path, format="png")
    except OSError as error:
        raise UsageError(f"{path}: cannot be written ({error.strerror})") from error
