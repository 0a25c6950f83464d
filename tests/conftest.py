"""What all tests share: figures that are shown after the run, and robots that drive in real time.

Tests run in two processes, a file at a time (``-n 2 --dist loadfile``). Files that drive robots for long come
last, so that two cores then have two robots at most and nothing else; before a file of real-time tests what
earlier ones left is collected, once; and a real-time test that failed while the machine itself stood still is
run again (`witness`), which is shown after the run.
"""

from __future__ import annotations

import atexit
import functools
import gc
import os
import time
from pathlib import Path

import hypothesis
import pytest
from _pytest.runner import runtestprotocol

from .witness import Witness

IN_CI = bool(os.environ.get("CI"))
"""There the same examples are drawn each time, so that a change is judged by what it changes."""
hypothesis.settings.register_profile("busy", deadline=None, derandomize=IN_CI)  # busy: time is no verdict
hypothesis.settings.register_profile("brief", deadline=None, max_examples=20, derandomize=True, database=None)
hypothesis.settings.load_profile("busy")

TESTS = Path(__file__).parent
REAL_TIME = (
    "drone",
    "e2e",
    "faults",
    "outside",
    "perception",
    "quadruped",
    "runtime",
    "test_doctor",
    "trial",
    "wheeled",
)
TRIES = 4
BEGAN_S = pytest.StashKey[float]()
MEASURED = "measured"


@pytest.fixture
def measured(record_property):
    """Give a function that has a line shown after the run, whatever process the test ran in."""

    def show(line: str) -> None:
        record_property(MEASURED, line)

    return show


def pytest_collection_modifyitems(items):
    last = set()
    for item in items:
        path = item.path.relative_to(TESTS).as_posix() if item.path.is_relative_to(TESTS) else ""
        if path.startswith(REAL_TIME):
            item.add_marker("realtime")
            if item.get_closest_marker("slow"):
                last.add(item.path)
    items.sort(key=lambda item: item.path in last)


@functools.cache
def witness() -> Witness:
    found = Witness()
    atexit.register(found.close)
    return found


@functools.lru_cache(maxsize=1)
def collect_before(_path: Path) -> None:
    """Collect what earlier files left; later collections only look at what is made from now on.

    A full one took up to 0.6 s in a process with torch and a thousand tests behind it, in which whatever part
    of a robot ran there was silent.
    """
    gc.collect()
    gc.freeze()


def pytest_runtest_protocol(item, nextitem):
    """Run a real-time test again, robots and all, that failed while the machine stood still."""
    if not item.get_closest_marker("realtime"):
        return None
    item.ihook.pytest_runtest_logstart(nodeid=item.nodeid, location=item.location)
    collect_before(item.path)
    witness()  # watches from now on
    since_s = (item.getparent(pytest.Class) or item).stash.setdefault(BEGAN_S, time.monotonic())
    for tries_left in reversed(range(TRIES)):
        reports = runtestprotocol(item, nextitem=nextitem, log=False)
        stall_s = witness().longest_s(since_s)
        if not (tries_left and stall_s and any(report.failed for report in reports)):
            break
        item.session._setupstate.teardown_exact(None)  # a class's robot may be what has stopped
        again = f"run again, for the machine stood still for {stall_s:.2f} s: {item.nodeid}"
        item.user_properties = [(MEASURED, again)]
        witness().wait_until_calm()
        since_s = time.monotonic()
    for report in reports:
        item.ihook.pytest_runtest_logreport(report=report)
    item.ihook.pytest_runtest_logfinish(nodeid=item.nodeid, location=item.location)
    return True


def pytest_terminal_summary(terminalreporter):
    reports = [report for kind in ("passed", "failed") for report in terminalreporter.getreports(kind)]
    lines = [
        line
        for report in reports
        for name, line in getattr(report, "user_properties", ())
        if name == MEASURED
    ]
    if lines:
        terminalreporter.section(MEASURED)
        for line in sorted(lines):
            terminalreporter.line(line)
