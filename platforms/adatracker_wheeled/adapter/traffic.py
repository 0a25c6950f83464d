"""The CAN traffic of a trial: every frame that was heard or sent, in candump's log format (``candump -L``).

`Traffic` writes ``can.log`` into the trial's folder from a thread of its own, so that neither the receive
thread nor the link ever waits for a disk. Each line stands alone, reaches the kernel within milliseconds and
the disk within a second: a kill loses nothing that was written, a power cut a second at most. The link's
process writes it, so it goes on after the tracker has died. Times are the run's clock, as `StepRecord.t_ns`.
"""

from __future__ import annotations

import io
import os
import threading
import time
from collections import deque
from typing import TYPE_CHECKING, Any

import can

from adatracker_deploy.core.errors import UsageError

if TYPE_CHECKING:
    from pathlib import Path

    from adatracker_deploy.core.clock import Clock

FILE_NAME = "can.log"
"""Name in the trial's folder."""
FORMATS = (".asc", ".blf")
"""Formats of `export_traffic`, by file name suffix: Vector's text and binary logs."""
_BACKLOG = 20_000
"""Frames that wait at most, 0.4 kB each: those before the trial's folder is known, and while a disk stalls. A
base and its commands bring some 300 a second, a full bus of 1 Mbit/s about 8,000."""
_BATCH_S = 0.01
_SYNC_S = 1.0


class Traffic:
    """Keeps the newest frames, and writes them all once it knows where.

    Where more frames wait than `_BACKLOG`, the oldest go, and a notice says how many.

    Args:
        clock: the run's.
        channel: names the bus in the log.
    """

    def __init__(self, clock: Clock, channel: str) -> None:
        self._clock = clock
        self._channel = "_".join(channel.split()) or "can"
        self._waiting: deque[tuple[int, Any]] = deque()
        self._news = threading.Event()
        self._closed = threading.Event()
        self._thread: threading.Thread | None = None
        self._dropped = 0
        self._ended = False
        self._notices: deque[str] = deque()

    def add(self, message: Any) -> None:
        """Take one of python-can's messages, heard or sent just now; never blocks. Its own time is unused."""
        if self._ended:
            return
        if len(self._waiting) >= _BACKLOG:
            self._waiting.popleft()
            self._dropped += self._thread is not None
        self._waiting.append((self._clock.now_ns(), message))
        self._news.set()

    def record(self, folder: Path) -> None:
        """Write into ``FOLDER/can.log`` from now on, what has been kept first; only the first call counts."""
        if self._thread is None:
            self._thread = threading.Thread(
                target=self._run, args=(folder / FILE_NAME,), name="can-log", daemon=True
            )
            self._thread.start()

    def notices(self) -> tuple[str, ...]:
        """Return what went wrong since the last call, for the operator."""
        return tuple(self._notices.popleft() for _ in range(len(self._notices)))

    def close(self) -> None:
        """Write what still waits; may be called twice."""
        self._closed.set()
        self._news.set()
        if self._thread is not None:
            self._thread.join(1.0)

    def _run(self, path: Path) -> None:
        try:
            fd = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
            with os.fdopen(fd, "w", encoding="ascii") as file:
                self._write_all(file)
        except OSError as error:  # a full disk must not stop the robot
            self._notices.append(f"the CAN log ends early: {path}: {error.strerror}")
        self._ended = True
        self._waiting.clear()
        if self._dropped:
            self._notices.append(f"the CAN log lacks {self._dropped} frames: the disk was too slow")

    def _write_all(self, file: Any) -> None:
        writer = can.CanutilsLogWriter(file, channel=self._channel)
        synced_s = time.monotonic()
        while not self._closed.is_set() or self._waiting:
            self._news.wait()
            self._news.clear()
            while self._waiting:
                t_ns, message = self._waiting.popleft()
                message.timestamp, message.channel = t_ns / 1e9, None
                writer.on_message_received(message)
            file.flush()
            if time.monotonic() - synced_s > _SYNC_S:
                os.fdatasync(file.fileno())
                synced_s = time.monotonic()
            self._closed.wait(_BATCH_S)
        os.fdatasync(file.fileno())


def export_traffic(folder: Path, out: Path, ahead_ns: int) -> None:
    """Write a trial's CAN traffic as one of `FORMATS`.

    Args:
        folder: of the trial.
        out: the file to write; its suffix chooses the format.
        ahead_ns: by what wall-clock time is ahead of the run's clock, ns.

    Raises:
        UsageError: the trial has no CAN log, or a file cannot be read or written.
    """
    source = folder / FILE_NAME
    if not source.is_file():
        raise UsageError(f"{folder}: no {FILE_NAME} in it: no CAN bus was open, as in a dry run")
    try:
        text = source.read_text(encoding="ascii")
        whole = io.StringIO(text[: text.rfind("\n") + 1])  # a kill may have cut the last line
        with can.CanutilsLogReader(whole) as messages, can.Logger(out) as write:
            for message in messages:
                message.timestamp += ahead_ns / 1e9
                write(message)
    except OSError as error:
        raise UsageError(f"{error.filename or out}: {error.strerror}") from error
    except (ValueError, IndexError) as error:
        raise UsageError(f"{source}: is not a candump log: {error}") from error
