"""What is asked for is what the kernel gives to the right threads, or is refused in a line."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from adatracker_deploy.errors import UsageError
from adatracker_deploy.runtime.clock import MonotonicClock
from adatracker_deploy.runtime.link_process import LinkProcess
from adatracker_deploy.runtime.scheduling import (
    LINK_PRIORITY,
    LOOP_PRIORITY,
    Scheduling,
    cpus_text,
    obtained,
    read_cpus,
)
from adatracker_deploy.testing.fake import FakePlatform, fake_profile

USABLE = os.sched_getaffinity(0)
ONE = frozenset({max(USABLE)})
WHERE = f"on cores {max(USABLE)}"


def allowed():
    try:
        Scheduling(realtime=True).check()
    except UsageError:
        return False
    return True


needs_permission = pytest.mark.skipif(not allowed(), reason="needs leave for real-time priority")


@given(st.sets(st.integers(0, 200), min_size=1))
def test_a_list_of_cores_is_read_as_it_is_written(cpus):
    assert read_cpus(cpus_text(cpus), set(range(201))) == cpus


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "'' is neither"),
        ("0,", "'' is neither"),
        ("all", "'all' is neither"),
        ("3-1", "'3-1' is neither"),
        ("-1", "'-1' is neither"),
        ("1 ", "'1 ' is neither"),
        ("0,2-4", "core 4 cannot be used; there are 0-3"),
        ("0-99999999999999", "'0-99999999999999' is neither"),
    ],
)
def test_what_is_no_list_of_cores_that_there_are_is_refused(text, words):
    with pytest.raises(UsageError, match=words):
        read_cpus(text, {0, 1, 2, 3})


def test_the_thread_that_asks_has_it_and_nobody_else_and_gives_it_back():
    before, ready, done = obtained(), threading.Event(), threading.Event()

    def other():
        ready.set()
        done.wait()

    bystander = threading.Thread(target=other)
    bystander.start()
    ready.wait()
    with Scheduling(cpus=ONE).of_this_thread(LOOP_PRIORITY):
        assert obtained() == f"ordinary priority {WHERE}"
        assert os.sched_getaffinity(bystander.native_id) == USABLE
    assert obtained() == before
    done.set()
    bystander.join()


@needs_permission
def test_real_time_priority_is_had_and_given_back():
    before = obtained()
    with Scheduling(realtime=True, cpus=ONE).of_this_thread(LOOP_PRIORITY):
        assert obtained() == f"SCHED_FIFO {LOOP_PRIORITY} {WHERE}"
    assert obtained() == before


def test_nothing_asked_for_is_nothing_changed():
    before = obtained()
    with Scheduling().of_this_thread(LOOP_PRIORITY):
        assert obtained() == before


class Threaded(FakePlatform):
    """Has a thread of its own, as adapters do."""

    def connect(self):
        super().connect()
        named = threading.Event()

        def run():
            Path("/proc/thread-self/comm").write_text("adapter")
            named.set()
            threading.Event().wait()

        threading.Thread(target=run, daemon=True).start()
        named.wait()


@pytest.mark.parametrize(
    "scheduling",
    [
        Scheduling(cpus=ONE),
        pytest.param(Scheduling(realtime=True, cpus=ONE), marks=needs_permission),
    ],
)
def test_the_link_and_its_adapters_threads_have_it(scheduling):
    told = f"SCHED_FIFO {LINK_PRIORITY}" if scheduling.realtime else "ordinary priority"
    with LinkProcess(Threaded, fake_profile(), MonotonicClock(), scheduling) as link:
        link.connect()
        tasks = Path(f"/proc/{link.pid}/task").iterdir()
        (adapters,) = (task for task in tasks if (task / "comm").read_text().strip() == "adapter")
        assert obtained(link.pid) == obtained(int(adapters.name)) == f"{told} {WHERE}"


POWERLESS = """
import os, resource, sys
from adatracker_deploy.errors import UsageError
from adatracker_deploy.runtime.scheduling import Scheduling, obtained

resource.setrlimit(resource.RLIMIT_RTPRIO, (0, 0))
if os.geteuid() == 0:
    os.setuid(65534)
before = obtained()
try:
    Scheduling(realtime=True).check()
except UsageError as error:
    print(error)
assert obtained() == before
"""


def test_a_user_without_leave_is_told_how_to_get_it():
    done = subprocess.run([sys.executable, "-c", POWERLESS], capture_output=True, text=True, check=True)
    (line,) = done.stdout.splitlines()
    assert "--realtime: the system refuses it (Operation not permitted)" in line
    assert "USER - rtprio 50" in line
