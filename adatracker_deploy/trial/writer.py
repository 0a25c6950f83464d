"""The log's writer, a process of its own: `TrialLog` starts ``python -m adatracker_deploy.trial.writer``.

It lives until its socket reaches the end of file, whether the tracker closed it or was killed; then it
finishes the file, and only then does ``trial.mcap.part`` become ``trial.mcap``. It ignores SIGINT, SIGTERM
and SIGHUP, which reach a whole process group: the end of a run is the tracker's to say.

Each tick is flushed to the kernel, which survives a kill of every process here; `fdatasync` at most a second
later, which survives a power cut (1.4 ms, measured). When the disk is full the file is cut back to its last
whole tick and left as ``.part``, readable so far.

The live view and the operator's page, where they were asked for, are served from here as well: every tick is
encoded once, written, then shown. A view that fails ends, and the log goes on; a log that fails ends, and the
views go on.
"""

from __future__ import annotations

import contextlib
import fcntl
import os
import signal
import socket
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import cv2

from adatracker_deploy.core.errors import UsageError, line_of
from adatracker_deploy.trial.channels import Encoder
from adatracker_deploy.trial.folder import sync_folder
from adatracker_deploy.trial.ipc import (
    End,
    Free,
    LogFailed,
    LogLine,
    Look,
    PictureSlots,
    Post,
    Ready,
    Start,
    Step,
)
from adatracker_deploy.trial.live_view import LiveView
from adatracker_deploy.trial.page_view import PageView
from adatracker_deploy.trial.trial_file import TrialFile

if TYPE_CHECKING:
    from adatracker_deploy.core.messages import Click
    from adatracker_deploy.trial.channels import Message

SYNC_INTERVAL_S = 1.0


class WholeTicks:
    """An unbuffered file that takes what was written since the last flush whole, or not at all."""

    def __init__(self, path: Path) -> None:
        self._fd = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
        fcntl.flock(self._fd, fcntl.LOCK_EX)  # as long as it is held, nobody takes the log for unfinished
        self._end = 0
        self._pending = bytearray()

    def write(self, data: bytes) -> int:
        """Keep data for the next flush."""
        self._pending += data
        return len(data)

    def tell(self) -> int:
        """Return where the next byte will be."""
        return self._end + len(self._pending)

    def flush(self) -> None:
        """Write what is pending.

        Raises:
            OSError: not all of it could be written; the file ends where it ended before.
        """
        data, self._pending = bytes(self._pending), bytearray()
        try:
            left = memoryview(data)
            while left:
                left = left[os.write(self._fd, left) :]
        except OSError:
            os.ftruncate(self._fd, self._end)
            os.lseek(self._fd, self._end, os.SEEK_SET)
            raise
        self._end += len(data)

    def sync(self) -> None:
        """Bring the file to the disk."""
        os.fdatasync(self._fd)

    def close(self) -> None:
        """Release the file."""
        os.close(self._fd)


class TrialWriter:
    """Writes one trial, from the first message to the end of file."""

    def __init__(self, post: Post, slots: PictureSlots) -> None:
        self._post = post
        self._slots = slots
        self._view: LiveView | None = None
        self._page: PageView | None = None
        self._summary_json: str | None = None
        self._last_sync_s = time.monotonic()
        self._unsynced = False

    def run(self) -> None:
        """Write until the tracker closes its end."""
        start: Start = self._post.receive(timeout_s=None)
        try:
            self._encoder = Encoder(start.frames)
            if start.live_port is not None:
                self._view = LiveView(start.live_port)
            if start.page is not None:
                self._page = PageView(start.page)
            self._write_trial(start)
        except UsageError as error:
            self._tell(LogFailed(str(error)))
        finally:
            for shown in (self._view, self._page):
                if shown is not None:
                    shown.close()

    def _write_trial(self, start: Start) -> None:
        part, path = Path(start.part), Path(start.path)
        try:
            self._file = WholeTicks(part)
            self._trial = TrialFile(cast("Any", self._file), start.metadata)
            self._file.flush()
            self._file.sync()
            sync_folder(part.parent)
            sync_folder(part.parent.parent)
        except OSError as error:
            self._tell(LogFailed(f"{part}: {error.strerror}"))
            return
        self._tell(Ready())
        try:
            self._write_all()
            self._trial.finish(self._summary_json)
            self._file.flush()
            self._file.sync()
            self._file.close()
            part.rename(path)
            sync_folder(path.parent)
        except OSError as error:
            self._tell(LogFailed(f"the log ends early: {part}: {error.strerror}"))
            self._drain()

    def _write_all(self) -> None:
        with contextlib.suppress(EOFError):
            while True:
                message = self._next()
                if message is None:
                    continue
                messages = self._encode(message)
                if not isinstance(message, Look):
                    self._trial.write(messages)
                    self._file.flush()
                    self._unsynced = True
                    self._show(messages)
                self._show_page(message, messages)

    def _next(self) -> Any:
        """Return the next message; None after the file was synced instead."""
        due_s = self._last_sync_s + SYNC_INTERVAL_S - time.monotonic()
        if not self._unsynced:
            return self._post.receive(timeout_s=None)
        if due_s > 0:
            with contextlib.suppress(TimeoutError):
                return self._post.receive(timeout_s=due_s)
        self._file.sync()
        self._last_sync_s, self._unsynced = time.monotonic(), False
        return None

    def _encode(self, message: Step | Look | LogLine | End) -> list[Message]:
        """Return what is to be written of a message; nothing, which is told, where it cannot be encoded."""
        try:
            match message:
                case Step(wall_ns, captured_ns, record, _):
                    return self._encode_picture(message) + self._encoder.step(wall_ns, captured_ns, record)
                case Look():
                    return self._encode_picture(message)
                case LogLine(wall_ns, level, text):
                    return self._encoder.event(wall_ns, level, text)
                case End(summary_json):
                    self._summary_json = summary_json
        except (TypeError, ValueError, cv2.error) as error:
            self._tell(LogFailed(f"a tick could not be logged: {line_of(error)}"))
        return []

    def _encode_picture(self, message: Step | Look) -> list[Message]:
        if message.place is None:
            return []
        seq = message.record.frame_seq if isinstance(message, Step) else message.seq
        try:
            picture = self._slots.get(message.place)
            return self._encoder.picture(message.wall_ns, message.captured_ns, seq, picture)
        finally:
            self._tell(Free(message.place.slot))

    def _show(self, messages: list[Message]) -> None:
        """Hand messages to the live view; one that fails is given up, and the log says so."""
        if self._view is None:
            return
        try:
            self._view.show(messages)
        except Exception as error:  # whatever becomes of the view, the log goes on
            self._view.close()
            self._view = None
            text = f"the live view has ended: {line_of(error)}"
            self._trial.write(self._encoder.event(time.time_ns(), "warning", text))

    def _show_page(self, message: Step | Look | LogLine | End, messages: list[Message]) -> None:
        """Hand a message to the operator's page, and to the tracker where the operator has clicked."""
        if self._page is None:
            return
        match message:
            case Step(record=record):
                self._page.step(record, messages)
            case Look():
                self._page.look(message, messages)
            case LogLine(_, level, text):
                self._page.event(level, text)
        for click in self._page.clicks():
            self._tell(click)

    def _drain(self) -> None:
        """Take and show what still comes, so that a log that failed looks no different to the loop."""
        with contextlib.suppress(EOFError):
            while True:
                message = self._post.receive(timeout_s=None)
                if self._view is not None or self._page is not None:
                    messages = self._encode(message)
                    if not isinstance(message, Look):
                        self._show(messages)
                    self._show_page(message, messages)
                elif isinstance(message, Step) and message.place is not None:
                    self._tell(Free(message.place.slot))

    def _tell(self, message: Ready | Free | LogFailed | Click) -> None:
        with contextlib.suppress(OSError):  # a tracker that has gone needs no message
            self._post.send(message, timeout_s=1.0)


def main() -> None:
    """Run the writer on the socket and the memory whose file descriptors are the two arguments."""
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)
    cv2.setNumThreads(1)
    socket_fd, memory_fd = map(int, sys.argv[1:])
    post = Post(socket.socket(fileno=socket_fd))
    with contextlib.suppress(EOFError):  # gone before it said where to write
        TrialWriter(post, PictureSlots(memory_fd)).run()


if __name__ == "__main__":
    main()
