"""Keys that only their owner may read."""

from __future__ import annotations

import stat
from pathlib import Path

from adatracker_deploy.core.errors import UsageError


def check_secret(name: str, *, where: str) -> Path:
    """Return the path of a file that holds a secret.

    Args:
        name: the file.
        where: how errors name the setting that names it.

    Raises:
        UsageError: it is not there, is no plain file, or others than its owner may read or change it.
    """
    path = Path(name)
    try:
        mode = path.stat().st_mode
    except OSError as error:
        raise UsageError(f"{where}: no such file: {name}") from error
    if not stat.S_ISREG(mode):
        raise UsageError(f"{where}: {name} is not a plain file")
    if mode & (stat.S_IRWXG | stat.S_IRWXO):
        raise UsageError(f"{where}: others may read or change {name}: chmod 600 it")
    return path
