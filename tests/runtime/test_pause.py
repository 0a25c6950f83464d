"""A rehearsed sleep: the clock of everybody who shares it stands still, and tells of it."""

from __future__ import annotations

import pickle
import subprocess
import sys
import time

import pytest

from adatracker_deploy.core import pause
from adatracker_deploy.core.clock import MonotonicClock

SLEPT_NS = 2_000_000_000


@pytest.fixture
def path(tmp_path):
    pause.create(str(tmp_path / "pause"))
    return str(tmp_path / "pause")


def test_a_clock_without_a_pause_is_the_machines():
    before_ns = time.monotonic_ns()
    assert before_ns <= MonotonicClock().now_ns() <= time.monotonic_ns()


@pytest.mark.parametrize("speed", [1.0, 5.0])
def test_what_was_slept_has_not_passed_on_any_copy_of_the_clock(path, speed):
    clock = MonotonicClock(speed=speed, pause=path)
    copy = pickle.loads(pickle.dumps(clock))
    epoch = MonotonicClock(speed=speed, epoch_ns=clock.epoch_ns)
    asleep_ns = clock.suspended_ns()
    pause.add(path, SLEPT_NS)
    for one in (clock, copy):
        assert epoch.now_ns() - one.now_ns() >= SLEPT_NS * speed - 50_000_000 * speed
        assert one.suspended_ns() - asleep_ns == SLEPT_NS


def test_another_process_sees_it_too(path):
    say = "import sys; from adatracker_deploy.core import pause; pause.add(sys.argv[1], int(sys.argv[2]))"
    for slept_ns in (SLEPT_NS, 5):
        subprocess.run([sys.executable, "-c", say, path, str(slept_ns)], check=True)
    assert pause.total_ns(path) == SLEPT_NS + 5


def test_a_file_that_is_there_is_not_taken(path):
    with pytest.raises(FileExistsError):
        pause.create(path)
