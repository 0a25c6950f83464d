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

ALONE = ("e2e/", "outside/")
UNTIMED = ("test_operator_stop.py", "test_rehearsal_alone.py")
"""Files there that time nothing, and so run beside others."""
ELSEWHERE = ("test_ros2_rehearsal.py", "test_ros2_stops.py")
"""Whole rehearsals that stand with their robot's other tests."""
ALSO_WAITING = (
    *("runtime/test_remote_stops.py", "testing/test_conformance_catches.py", "unreal/test_world.py"),
    *("wheeled/test_engage_and_stop.py", "wheeled/test_one_owner.py", "wheeled/test_wheeled_conformance.py"),
    *("wheeled/test_wheeled_faults.py", "wheeled/test_wheeled_sends.py"),
)
"""Files that keep a core busy for less than a third of their time, though few of their tests are slow."""
BUSY = (
    *("drone/test_rehearsal_alone.py", "e2e/test_operator_stop.py", "perception/test_leaks.py"),
    *("perception/test_mjpeg.py", "quadruped/test_engage_and_stop.py", "quadruped/test_fuzz.py"),
    *("quadruped/test_sitl.py", "quadruped/test_sitl_stops.py", "ros2/", "wheeled/test_socketcan.py"),
)
"""Files that drive robots, too, but keep half a core busy or were not measured: two run side by side."""
TESTS = Path(__file__).parent
SHARES = 6
POLL_S = 0.02


class Takes(enum.IntEnum):
    """Shares of the machine that a file takes."""

    COMPUTING = SHARES // 2
    WAITING = SHARES // 3
    ALL = SHARES


_waiting: set[Path] = set()
"""Files that drive robots, and so mostly wait."""
_turns = contextlib.ExitStack()
"""The turn that this worker holds: from the first test of a file to its last."""
_held: list[Path] = []


def takes(path: Path) -> Takes:
    """Return what a file takes, once its tests were collected."""
    name = path.relative_to(TESTS).as_posix() if path.is_relative_to(TESTS) else ""
    if (name.startswith(ALONE) and path.name not in UNTIMED) or path.name in ELSEWHERE:
        return Takes.ALL
    return Takes.WAITING if path in _waiting and not name.startswith(BUSY) else Takes.COMPUTING


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(items):
    """Let files that compute come first, then those that drive robots, then whole rehearsals."""
    _waiting.update(TESTS / name for name in ALSO_WAITING)
    real_time = (item for item in items if item.get_closest_marker("realtime"))
    _waiting.update(item.path for item in real_time if item.get_closest_marker("slow"))
    items.sort(key=lambda item: (takes(item.path) is Takes.ALL, item.path in _waiting))


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
