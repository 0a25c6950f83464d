"""Runs a real-time test again that failed while the machine itself stood still, and hides nothing by it.

A pytest plugin, which `conftest` loads. A test is run again only if

* it is marked ``realtime`` and really was: since it, or its class, began, it started a thread or a process,
  or used a socket. A pure test that fails has failed;
* the machine stood still while it ran, or its host took a share of the processors: from the test's own
  start, its fixtures' set-up included, to its own end. A class's robot is started in its first test's window.
  A stall that stopped it in an earlier test fails that one, which is run again with a new robot; one after
  which an earlier test passed has stopped nothing.

Every try that failed is shown at the end of the run and counted, and in CI more than `MOST_FAILED_TRIES` fail
it: a test that fails two times of three is no test that passes.
"""

from __future__ import annotations

import atexit
import functools
import gc
import os
import sys
import threading
import time
from typing import TYPE_CHECKING

import pytest
from _pytest.runner import runtestprotocol

from tests.witness import STOLEN, Witness, processor_times, stolen_share

if TYPE_CHECKING:
    from pathlib import Path

TRIES = 3
MOST_FAILED_TRIES = 3
FAILED_TRY = "failed try"
_REAL_TIME_EVENTS = frozenset(
    {
        *("subprocess.Popen", "os.fork", "os.posix_spawn"),
        *("socket.connect", "socket.bind", "socket.sendto"),
    }
)
"""Python's audit events of what makes a test wait for the machine (PEP 578; docs, Audit events table)."""
_EVENTS = pytest.StashKey[int]()
_events = 0
_reported: list[str] = []
"""Every try that failed, of all processes; in the one that shows them."""


_strangers: frozenset[int] = frozenset()
"""Threads that were there before: what they do is not the test's."""


def _count() -> None:
    global _events  # noqa: PLW0603 -- an audit hook lasts as long as the interpreter does
    if threading.get_ident() not in _strangers:
        _events += 1


def _hear(event: str, _: object) -> None:
    if event in _REAL_TIME_EVENTS:
        _count()


def _begin(group) -> int:
    """Return how many events there were before a test, or its class, and forget who was there before."""
    global _strangers  # noqa: PLW0603 -- as above
    if _EVENTS not in group.stash:
        group.stash[_EVENTS] = _events
        there = {thread.ident for thread in threading.enumerate()}
        _strangers = frozenset(there - {threading.get_ident(), None})
    return group.stash[_EVENTS]


sys.addaudithook(_hear)
_start_thread = threading.Thread.start


def _start_and_count(thread: threading.Thread) -> None:
    """Start a thread, which Python tells its auditors of from 3.12 on."""
    _count()
    _start_thread(thread)


threading.Thread.start = _start_and_count


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
    watched = witness()  # from now on
    events = _begin(item.getparent(pytest.Class) or item)
    for tries_left in reversed(range(TRIES)):
        since_s, times = time.monotonic(), processor_times()
        reports = runtestprotocol(item, nextitem=nextitem, log=False)
        trouble = _trouble(watched.longest_s(since_s), stolen_share(times, processor_times()))
        failed = [report for report in reports if report.failed]
        if not (tries_left and trouble and failed and _events > events):
            break
        _note(item, failed[0], trouble)
        item.session._setupstate.teardown_exact(None)  # a class's robot may be what has stopped
        watched.wait_until_calm()
    for report in reports:
        item.ihook.pytest_runtest_logreport(report=report)
    item.ihook.pytest_runtest_logfinish(nodeid=item.nodeid, location=item.location)
    return True


def _trouble(stall_s: float, stolen: float) -> str:
    """Return what was wrong with the machine meanwhile; empty if nothing was."""
    if stall_s:
        return f"the machine stood still for {stall_s:.2f} s"
    return f"the machine's host took {100 * stolen:.0f} % of it" if stolen >= STOLEN else ""


def _note(item, report, trouble: str) -> None:
    """Keep how a try failed; it travels with the last try's reports, from a worker process too."""
    crash = getattr(report.longrepr, "reprcrash", None)
    why = (crash.message if crash else str(report.longrepr)).strip().splitlines()[0]
    said = f"{item.nodeid}: {why} ({trouble})"
    item.user_properties = [*item.user_properties, (FAILED_TRY, said)]


def pytest_runtest_logreport(report):
    if report.when == "teardown":  # one report of each test
        _reported.extend(said for name, said in report.user_properties if name == FAILED_TRY)


@pytest.hookimpl(trylast=True)
def pytest_sessionfinish(session):
    in_worker = hasattr(session.config, "workerinput")
    if not in_worker and os.environ.get("CI") and len(_reported) > MOST_FAILED_TRIES:
        session.exitstatus = pytest.ExitCode.TESTS_FAILED


def pytest_terminal_summary(terminalreporter):
    if not _reported:
        return
    terminalreporter.section("tries that failed, and were run again")
    for said in _reported:
        terminalreporter.line(said)
    allowed = f"; CI allows {MOST_FAILED_TRIES}" if len(_reported) > MOST_FAILED_TRIES else ""
    terminalreporter.line(f"{len(_reported)} in all{allowed}")
