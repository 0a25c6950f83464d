"""A trial's folder: its name, its files, and atomic writing of small files."""

from __future__ import annotations

import contextlib
import os
import tempfile
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

from adatracker_deploy.core.errors import UsageError

if TYPE_CHECKING:
    from collections.abc import Iterator

FILE_NAME = "trial.mcap"
PART_NAME = FILE_NAME + ".part"
"""Its name while it is written, and for ever when the writer could not finish it."""
SUMMARY_NAME = "summary.json"
CONFIG_NAME = "config.yaml"


def place_for_logs(log_dir: Path) -> Path:
    """Return `log_dir`, or the nearest folder above it that exists; nothing stays made there.

    Raises:
        UsageError: it cannot be written to.
    """
    log_dir = log_dir.absolute()
    nearest = next(folder for folder in (log_dir, *log_dir.parents) if os.path.lexists(folder))
    try:
        Path(tempfile.mkdtemp(prefix=".adatracker-", dir=nearest)).rmdir()  # what a run would do, not a guess
    except OSError as error:
        raise UsageError(
            f"log folder {log_dir}: nothing can be made in {nearest} ({error.strerror}); choose another with "
            "--log-dir"
        ) from error
    return nearest


def new_folder(log_dir: Path, wall_ns: int, suffix: str) -> Path:
    """Make ``LOG_DIR/<UTC time>_<suffix>/`` (mode 0700), one millisecond later when the name is taken.

    Raises:
        UsageError: it cannot be made.
    """
    with writable(log_dir):
        log_dir.mkdir(parents=True, exist_ok=True)
        while True:
            stamp = datetime.fromtimestamp(wall_ns / 1e9, UTC).strftime("%Y%m%d-%H%M%S-%f")[:-3]
            folder = log_dir / f"{stamp}_{suffix}"
            try:
                folder.mkdir(mode=0o700)
            except FileExistsError:
                wall_ns += 1_000_000
            else:
                return folder


@contextlib.contextmanager
def writable(folder: Path) -> Iterator[None]:
    """Turn what the file system refuses into a line the operator can act on."""
    try:
        yield
    except OSError as error:
        raise UsageError(
            f"log folder {folder}: cannot be written ({error.strerror}); choose another with --log-dir"
        ) from error


def sync_folder(folder: Path) -> None:
    """Sync a folder's entries to disk, so that they survive a power cut."""
    fd = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(fd)
    finally:
        os.close(fd)


def write_file(path: Path, text: str) -> None:
    """Write a small file atomically, readable by its owner only."""
    part = path.with_name(path.name + ".part")
    fd = os.open(part, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600)
    with os.fdopen(fd, "w", encoding="utf-8") as file:
        file.write(text)
        file.flush()
        os.fsync(file.fileno())
    part.rename(path)
