"""Reads a device in a thread of its own; one that fails in any way is lost."""

from __future__ import annotations

import contextlib
import os
import select
import threading
from typing import TYPE_CHECKING

from adatracker_deploy.runtime.teleop.takeover import Code

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

Told = list[tuple[Code, float]]
"""Events that a device reported at one time: codes and values."""


@contextlib.contextmanager
def reading(fd: int, read: Callable[[], Told], put: Callable[..., None]) -> Iterator[None]:
    """Pass on what a device tells, until the context ends.

    Args:
        fd: becomes readable when there is something to tell, or the device is lost.
        read: returns it without waiting; an exception means that the device is lost.
        put: takes the events (`Hand.put`); ``gone`` is the last of a device that was lost.
    """
    end, ender = os.pipe()

    def watch() -> None:
        try:
            while True:
                ready, _, _ = select.select([fd, end], [], [])
                if end in ready:
                    return
                if told := read():
                    put(*told)
        except Exception:  # whatever it is, nobody holds the dead-man button any more
            put(("gone", 1.0))

    watcher = threading.Thread(target=watch, name="teleop", daemon=True)
    watcher.start()
    try:
        yield
    finally:
        os.close(ender)
        watcher.join()
        os.close(end)
