"""A machine that stands still is noticed, at the time when it did."""

from __future__ import annotations

import ctypes
import os
import threading
import time

from adatracker_deploy.faults.stalls import StallMonitor


def test_an_interpreter_that_stands_still_is_noticed_then_and_not_before():
    with StallMonitor() as stalls:
        before_ns = time.monotonic_ns()
        while True:  # the watcher sleeps by now, and is due
            ctypes.PyDLL(None).usleep(80_000)  # which keeps the interpreter's lock
            threading.Event().wait(0.02)
            if stalls.largest_s(before_ns, time.monotonic_ns()) > 0.05:
                break
    assert stalls.largest_s(0, before_ns - 10_000_000_000) == 0.0


def test_every_core_is_watched_and_the_rest_of_the_program_stays_where_it_may_run():
    cores = os.sched_getaffinity(0)

    def watched():
        threads = [thread for thread in threading.enumerate() if thread.name.startswith("stalls")]
        return [os.sched_getaffinity(thread.native_id) for thread in threads]

    with StallMonitor():
        end_s = time.monotonic() + 10
        while sorted(watched(), key=min) != [{core} for core in sorted(cores)]:
            assert time.monotonic() < end_s, watched()
        assert os.sched_getaffinity(0) == cores
    assert watched() == []
