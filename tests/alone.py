"""Keeps whole rehearsals from running beside another test: two cores drive one robot well, not always two.

A pytest plugin, which `conftest` loads. A file of `ALONE` runs while no other worker runs anything; all
others run side by side. A worker that waits for such a turn goes before those that ask after it.
"""

from __future__ import annotations

import contextlib
import fcntl
import os
import tempfile
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
_turns = contextlib.ExitStack()
"""What this worker holds: from the first test of a file to its last."""
_held: list[Path] = []


def is_alone(path: Path) -> bool:
    """Return whether the tests of a file run beside no others."""
    alone = path.is_relative_to(TESTS) and path.relative_to(TESTS).parts[0] in ALONE
    return (alone and path.name not in UNTIMED) or path.name in ELSEWHERE


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_runtest_protocol(item, nextitem):
    """Wait for the file's turn before its first test, and give it back after its last."""
    run = getattr(item.config, "workerinput", {}).get("testrunuid")
    if run and _held != [item.path]:
        _turns.enter_context(turn(Path(tempfile.gettempdir()) / f"turns-{run}", alone=is_alone(item.path)))
        _held[:] = [item.path]
    try:
        return (yield)
    finally:
        if nextitem is None or nextitem.path != item.path:
            _turns.close()
            _held.clear()


@contextlib.contextmanager
def turn(path: Path, *, alone: bool) -> Iterator[None]:
    """Hold a turn: alone, or beside others that are not.

    Two locks, of which the kernel frees what a killed process held: whoever waits for the second holds the
    first, so that nobody overtakes it.
    """
    with contextlib.ExitStack() as held:
        with _locked(path.with_suffix(".queue"), fcntl.LOCK_EX):
            held.enter_context(_locked(path.with_suffix(".turn"), fcntl.LOCK_EX if alone else fcntl.LOCK_SH))
        yield


@contextlib.contextmanager
def _locked(path: Path, how: int) -> Iterator[None]:
    fd = os.open(path, os.O_RDWR | os.O_CREAT, 0o600)
    try:
        fcntl.flock(fd, how)
        yield
    finally:
        os.close(fd)
