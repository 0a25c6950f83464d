"""Shares the machine between test files: two cores compute for two, or wait with three, or rehearse one.

A pytest plugin, which `conftest` loads. Each file takes its shares of the machine (`Takes`) from its first to
its last test. So three workers run two files that compute side by side; or three that drive a simulated robot
over its wire, each of which keeps a third of a core busy; or one whole rehearsal, which two cores drive well,
not always two of them. They run in this order. A worker that waits for its turn goes before those that ask
after it.
"""

from __future__ import annotations

import contextlib
import enum
import fcntl
import os
import tempfile
import time
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from collections.abc import Iterator

ALONE = ("e2e", "outside")
UNTIMED = ("test_operator_stop.py", "test_rehearsal_alone.py")
"""Files there that time nothing, and so run beside others."""
ELSEWHERE = ("test_ros2_rehearsal.py", "test_ros2_stops.py")
"""Whole rehearsals that stand with their robot's other tests."""
TESTS = Path(__file__).parent
SHARES = 6
POLL_S = 0.02


class Takes(enum.IntEnum):
    """Shares of the machine that a file takes."""

    COMPUTING = SHARES // 2
    WAITING = SHARES // 3
    ALL = SHARES


_waiting: set[Path] = set()
"""Files that mostly wait."""
_turns = contextlib.ExitStack()
"""The turn that this worker holds: from the first test of a file to its last."""
_held: list[Path] = []


def takes(path: Path) -> Takes:
    """Return what a file takes, once its tests were collected."""
    alone = path.is_relative_to(TESTS) and path.relative_to(TESTS).parts[0] in ALONE
    if (alone and path.name not in UNTIMED) or path.name in ELSEWHERE:
        return Takes.ALL
    return Takes.WAITING if path in _waiting else Takes.COMPUTING


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(items):
    """Let files that compute come first, then those that wait, then whole rehearsals."""
    real_time = (item for item in items if item.get_closest_marker("realtime"))
    _waiting.update(item.path for item in real_time if item.get_closest_marker("slow"))
    order = (Takes.COMPUTING, Takes.WAITING, Takes.ALL)
    items.sort(key=lambda item: order.index(takes(item.path)))


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_runtest_protocol(item, nextitem):
    """Wait for the file's turn before its first test, and give it back after its last."""
    run = getattr(item.config, "workerinput", {}).get("testrunuid")
    if run and _held != [item.path]:
        _turns.enter_context(turn(Path(tempfile.gettempdir()) / f"turns-{run}", takes(item.path)))
        _held[:] = [item.path]
    try:
        return (yield)
    finally:
        if nextitem is None or nextitem.path != item.path:
            _turns.close()
            _held.clear()


@contextlib.contextmanager
def turn(path: Path, shares: int) -> Iterator[None]:
    """Hold so many shares of the machine.

    Each is a lock, of which the kernel frees what a killed process held. Whoever waits for shares holds the
    queue, so that nobody overtakes it.
    """
    with contextlib.ExitStack() as held:
        with _opened(path.with_suffix(".queue")) as queue:
            fcntl.flock(queue, fcntl.LOCK_EX)
            free = [held.enter_context(_opened(path.with_suffix(f".{at}"))) for at in range(SHARES)]
            while shares > 0:
                for fd in list(free):
                    if shares > 0 and _locked(fd):
                        free.remove(fd)
                        shares -= 1
                if shares > 0:
                    time.sleep(POLL_S)
        yield


@contextlib.contextmanager
def _opened(path: Path) -> Iterator[int]:
    fd = os.open(path, os.O_RDWR | os.O_CREAT, 0o600)
    try:
        yield fd
    finally:
        os.close(fd)


def _locked(fd: int) -> bool:
    with contextlib.suppress(BlockingIOError):
        fcntl.flock(fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
        return True
    return False
