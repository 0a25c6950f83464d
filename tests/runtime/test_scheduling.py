"""The right threads get the requested cores and priority, or the request is refused in one line."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from adatracker_deploy.core.clock import MonotonicClock
from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.runtime.link_process import LinkProcess
from adatracker_deploy.runtime.scheduling import (
    BESIDE_PRIORITY,
    LATENCY_FILE,
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


@pytest.fixture
def beside():
    """Give the id of another thread of this interpreter."""
    ready, done = threading.Event(), threading.Event()

    def wait():
        ready.set()
        done.wait()

    thread = threading.Thread(target=wait)
    thread.start()
    ready.wait()
    yield thread.native_id
    done.set()
    thread.join()


def test_the_loops_thread_has_its_cores_and_no_other_has_and_it_gives_them_back(beside):
    before = obtained(), obtained(beside)
    with Scheduling(cpus=ONE).while_looping():
        assert obtained() == f"ordinary priority {WHERE}"
        assert obtained(beside) == before[1]
    assert (obtained(), obtained(beside)) == before


@needs_permission
def test_real_time_priority_is_the_loops_and_less_of_it_is_for_whoever_may_hold_its_interpreters_lock(beside):
    before = obtained(), obtained(beside)
    with Scheduling(realtime=True, cpus=ONE).while_looping():
        assert obtained() == f"SCHED_FIFO {LOOP_PRIORITY} {WHERE}"
        assert obtained(beside) == f"SCHED_FIFO {BESIDE_PRIORITY} on cores {cpus_text(USABLE)}"
    assert (obtained(), obtained(beside)) == before


@needs_permission
def test_a_thread_that_ends_meanwhile_is_missed_by_nobody():
    done = threading.Event()
    thread = threading.Thread(target=done.wait)
    thread.start()
    with Scheduling(realtime=True).while_looping():
        done.set()
        thread.join()


def test_nothing_asked_for_is_nothing_changed():
    before = obtained()
    with Scheduling().while_looping():
        assert obtained() == before


@pytest.fixture
def latency_file(tmp_path, monkeypatch):
    """Give a stand-in for the kernel's /dev/cpu_dma_latency, which only some users may open."""
    file = tmp_path / "cpu_dma_latency"
    monkeypatch.setattr("adatracker_deploy.runtime.scheduling.LATENCY_FILE", file)
    return file


def is_open(file):
    return any(each.exists() and each.samefile(file) for each in Path("/proc/self/fd").iterdir())


def test_in_real_time_cores_are_kept_awake_by_an_open_file(latency_file):
    with Scheduling(realtime=True).awake() as awake:
        assert awake
        assert latency_file.read_bytes() == bytes(4)
        assert is_open(latency_file)
    assert not is_open(latency_file)


def test_cores_sleep_where_nothing_was_asked_for_or_the_system_does_not_allow_it(latency_file):
    with Scheduling().awake() as awake:
        assert not awake
    assert not latency_file.exists()
    latency_file.mkdir()
    with Scheduling(realtime=True).awake() as awake:
        assert not awake


@pytest.mark.skipif(not os.access(LATENCY_FILE, os.R_OK | os.W_OK), reason="needs leave to keep cores awake")
def test_the_kernel_grants_it():
    with Scheduling(realtime=True).awake() as awake:
        assert awake
        assert LATENCY_FILE.read_bytes()[:4] == bytes(4)


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
from adatracker_deploy.core.errors import UsageError
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
