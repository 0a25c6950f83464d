"""The log: what it holds, that it delays nothing, and that it survives what happens to it."""

from __future__ import annotations

import contextlib
import os
import re
import resource
import select
import signal
import stat
import statistics
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest
import yaml

from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.trial.ipc import SLOT_BYTES, SLOTS
from adatracker_deploy.trial.reader import read_trial
from tests.trial.records import START_NS, TICK_NS, a_frame, a_log, a_step, a_trial, an_observation

ROOT = Path(__file__).parents[2]


def log_steps(log, numbers):
    for number in numbers:
        log.step(a_step(number), a_frame(number), an_observation(number))


def eventually(condition, timeout_s=10.0):
    """Look again and again until something holds."""
    deadline_s = time.monotonic() + timeout_s
    pause = threading.Event()
    while not (found := condition()):
        assert time.monotonic() < deadline_s, "did not happen in time"
        pause.wait(0.01)
    return found


@contextlib.contextmanager
def stopped(pid):
    os.kill(pid, signal.SIGSTOP)
    try:
        yield
    finally:
        os.kill(pid, signal.SIGCONT)


def test_everything_that_was_logged_is_read_back(tmp_path):
    steps = [a_step(0), a_step(1, box=None, pose=None), a_step(2, state_age_s=float("inf"))]
    with a_log(tmp_path, steps=2) as log:
        for step in steps:
            log.step(step, a_frame(step.frame_seq), an_observation(step.frame_seq))
        log.event("warning", "the wind freshens", START_NS + TICK_NS)
        log.close({"outcome": "completed", "stop_s": 0.4})
    trial = read_trial(log.folder)
    assert trial.steps == tuple(steps)
    assert [(event.level, event.message) for event in trial.events] == [("warning", "the wind freshens")]
    assert (trial.platform, trial.kind, trial.policy, trial.planned_steps) == ("drone", "sitl", "pid", 2)
    assert trial.config == {"seed": 1, "profile": {"name": "drone"}}
    assert trial.summary == {"outcome": "completed", "stop_s": 0.4}
    assert trial.complete
    for seq, frame in enumerate(trial.frames()):
        assert frame.seq == seq
        assert np.array_equal(frame.mask, an_observation(seq).mask)
        assert np.abs(frame.rgb.astype(int) - a_frame(seq).rgb).max() <= 2  # JPEG
    assert log.dropped == log.frames_dropped == 0


def test_the_folder_is_as_promised_and_private(tmp_path):
    folder = a_trial(tmp_path / "made" / "on the way", [a_step(0)])
    assert re.fullmatch(r"\d{8}-\d{6}-\d{3}_drone_sitl", folder.name)
    assert {file.name for file in folder.iterdir()} == {"trial.mcap", "summary.json", "config.yaml"}
    assert stat.S_IMODE(folder.stat().st_mode) == 0o700
    assert {stat.S_IMODE(file.stat().st_mode) for file in folder.iterdir()} == {0o600}
    assert yaml.safe_load((folder / "config.yaml").read_text())["seed"] == 1


def test_trials_of_the_same_moment_have_folders_of_their_own(tmp_path, monkeypatch):
    monkeypatch.setattr(time, "time_ns", lambda: 1_800_000_000_000_000_000)
    assert a_trial(tmp_path, [a_step(0)]) != a_trial(tmp_path, [a_step(0)])


def test_a_folder_that_cannot_be_written_is_refused_before_anything_moves(tmp_path):
    (tmp_path / "occupied").write_text("a file")
    with pytest.raises(UsageError, match=r"cannot be written .* --log-dir"):
        a_log(tmp_path / "occupied")


def test_a_frame_that_several_ticks_saw_is_logged_once(tmp_path):
    folder = a_trial(tmp_path, [a_step(step, frame_seq=step // 3) for step in range(6)])
    trial = read_trial(folder)
    assert len(trial.steps) == 6
    assert [frame.seq for frame in trial.frames()] == [0, 1]


def test_a_tick_costs_its_thread_well_under_a_millisecond(tmp_path):
    spent_ms = []
    with a_log(tmp_path) as log:
        file = log.folder / "trial.mcap.part"
        for step in range(100):
            record, frame, seen = a_step(step), a_frame(step, 640, 480), an_observation(step, 640, 480)
            written = file.stat().st_size
            began_s = time.thread_time()
            log.step(record, frame, seen)
            spent_ms.append((time.thread_time() - began_s) * 1e3)
            eventually(lambda written=written: file.stat().st_size > written)
        assert log.frames_dropped == 0
    print(f"640x480: median {statistics.median(spent_ms):.2f} ms, max {max(spent_ms):.2f} ms")
    assert statistics.median(spent_ms) < 1.0


def test_a_writer_that_stands_still_delays_nothing_and_what_is_dropped_is_counted(tmp_path):
    with a_log(tmp_path) as log:
        with stopped(log.writer_pid):
            spent_s = []
            for step in range(1000):
                began_s = time.perf_counter()
                log_steps(log, [step])
                spent_s.append(time.perf_counter() - began_s)
        assert statistics.median(spent_s) < 0.001
        assert max(spent_s) < 0.1
        assert log.frames_dropped > 0
        assert 0 < log.dropped < 1000
        assert not log.trouble
    trial = read_trial(log.folder)
    assert len(trial.steps) == 1000 - log.dropped
    assert len(list(trial.frames())) == SLOTS


def test_steps_outlive_frames_when_the_writer_is_behind(tmp_path):
    with a_log(tmp_path) as log:
        with stopped(log.writer_pid):
            log_steps(log, range(SLOTS + 5))
        assert (log.dropped, log.frames_dropped) == (0, 5)
    assert len(read_trial(log.folder).steps) == SLOTS + 5


def test_a_dropped_tick_gives_its_frames_memory_back(tmp_path):
    with a_log(tmp_path) as log:
        with stopped(log.writer_pid):
            for step in range(1000):  # more than the way to the writer holds
                log.step(a_step(step, frame_seq=0), a_frame(0), an_observation(0))
            log_steps(log, range(1000, 1000 + 2 * SLOTS))
        eventually(lambda: len(read_trial(log.folder).steps) == 1000 + 2 * SLOTS - log.dropped)
        with stopped(log.writer_pid):
            log_steps(log, range(2000, 2000 + SLOTS))
    assert [frame.seq for frame in read_trial(log.folder).frames()] == [0, *range(2000, 2000 + SLOTS)]


def test_a_writer_that_died_is_told_as_trouble_and_never_raised(tmp_path):
    with a_log(tmp_path) as log:
        log_steps(log, range(5))
        eventually(lambda: len(read_trial(log.folder).steps) == 5)
        os.kill(log.writer_pid, signal.SIGKILL)
        eventually(lambda: log.trouble)
        log_steps(log, range(5, 8))
        log.event("info", "still here", START_NS)
        log.close({"outcome": "completed"})
    assert "writer" in log.trouble
    trial = read_trial(log.folder)
    assert len(trial.steps) == 5
    assert not trial.complete


def test_a_full_disk_is_trouble_within_a_second_and_leaves_the_log_so_far(tmp_path):
    with a_log(tmp_path) as log:
        log_steps(log, range(5))
        file = log.folder / "trial.mcap.part"
        eventually(lambda: len(read_trial(log.folder).steps) == 5)
        full_bytes = file.stat().st_size + 1000
        resource.prlimit(log.writer_pid, resource.RLIMIT_FSIZE, (full_bytes, full_bytes))
        log_steps(log, range(5, 10))
        eventually(lambda: log.trouble, timeout_s=1.0)
        log_steps(log, range(10, 100))
        assert log.dropped == 0  # the loop sees no difference
        log.close({"outcome": "completed"})
    assert "File too large" in log.trouble
    assert file.stat().st_size < full_bytes  # cut back to the last whole tick
    trial = read_trial(log.folder)
    assert trial.steps == tuple(a_step(step) for step in range(len(trial.steps)))
    assert len(trial.steps) >= 5


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_signals_to_everyone_leave_the_writer_to_its_work(tmp_path, number):
    with a_log(tmp_path) as log:
        log_steps(log, range(3))
        os.kill(log.writer_pid, number)
        log_steps(log, range(3, 6))
    assert len(read_trial(log.folder).steps) == 6
    assert not log.trouble


def test_a_tick_that_cannot_be_encoded_costs_that_tick_alone(tmp_path):
    with a_log(tmp_path) as log:
        log_steps(log, range(2))
        log.step(a_step(2, mode=object), a_frame(2), an_observation(2))
        log_steps(log, range(3, 5))
        log.close()
    assert "could not be logged" in log.trouble
    assert [step.step for step in read_trial(log.folder).steps] == [0, 1, 3, 4]


def test_a_frame_too_large_for_the_log_is_told_and_not_raised(tmp_path):
    with a_log(tmp_path) as log:
        side = int((SLOT_BYTES / 3) ** 0.5) + 1
        log.step(a_step(0), a_frame(0, side, side), an_observation(0))
        log_steps(log, [1])
    assert "too large" in log.trouble
    assert [step.step for step in read_trial(log.folder).steps] == [0, 1]


def test_killed_with_9_a_tracker_leaves_every_step_that_it_handed_over(tmp_path):
    command = [sys.executable, "-m", "tests.trial.endless_tracker", str(tmp_path)]
    with subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, text=True) as tracker:
        folder, writer_pid = tracker.stdout.readline().split()
        writer = os.pidfd_open(int(writer_pid))
        for line in tracker.stdout:
            if int(line) == 200:
                break
        tracker.kill()
        told = [int(line) for line in tracker.stdout.read().splitlines()[:-1]]  # the last may be half a line
    assert select.select([writer], [], [], 10)[0], "the writer did not end"
    os.close(writer)
    trial = read_trial(Path(folder))
    assert trial.complete
    assert trial.summary is None
    handed_over = max([200, *told])
    assert [step.step for step in trial.steps][: handed_over + 1] == list(range(handed_over + 1))
