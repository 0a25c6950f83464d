"""Checks that a secret key file is readable only by its owner."""

from __future__ import annotations

import stat
from pathlib import Path

from adatracker_deploy.core.errors import UsageError


def check_secret(name: str, *, where: str) -> Path:
    """Return the path of a secret file after checking its permissions.

    Args:
        name: the file.
        where: names the setting in errors.

    Raises:
        UsageError: it is missing, is not a regular file, or others than its owner may read or change it.
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
