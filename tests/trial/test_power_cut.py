"""A power cut costs a log its last second, no more: what was synced is all that a disk must still have.

Once by the writer's own clock, for any arrival of ticks and any moment of the cut; once with a file system on
a loop device, whose image is copied while the log is written and mounted again: what is in the copy is what
the disk had. That needs root. A drive that loses what it said was flushed is beyond both.
"""

from __future__ import annotations

import contextlib
import itertools
import os
import random
import shutil
import signal
import subprocess
from dataclasses import dataclass, field

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from adatracker_deploy.core.clock import MonotonicClock
from adatracker_deploy.runtime.pacer import Pacer
from adatracker_deploy.trial import writer
from adatracker_deploy.trial.ipc import LogLine, Start, Step
from adatracker_deploy.trial.reader import read_trial
from adatracker_deploy.trial.salvage import salvage
from tests.tiers import EXHAUSTIVE
from tests.trial.records import a_frame, a_log, a_step, an_observation

METADATA = {
    "trial": {"step_format": "1", "platform": "drone", "kind": "real", "policy": "pid", "steps": "600"},
    "config": {"yaml": "{}"},
}
MAY_LOSE_S = 1.0


@dataclass
class Arrivals:
    """The writer's post and its clock at once: each message comes at its time; waiting takes its time."""

    messages: list[tuple[float, object]]
    now_s: float = 100.0
    told: list[object] = field(default_factory=list)

    def monotonic(self):
        return self.now_s

    def send(self, message, timeout_s):
        self.told.append(message)

    def receive(self, timeout_s):
        if not self.messages:
            raise EOFError
        at_s, message = self.messages[0]
        if timeout_s is not None and at_s > self.now_s + timeout_s:
            self.now_s += timeout_s
            raise TimeoutError
        self.now_s = max(self.now_s, at_s)
        del self.messages[0]
        return message


def write(folder, arrivals, monkeypatch):
    """Write a log; return what the disk had from when on: [(time, bytes)]."""
    disk = []

    class Disk(writer.WholeTicks):
        def sync(self):
            super().sync()
            disk.append((arrivals.now_s, part.read_bytes()))

    part = folder / "trial.mcap.part"
    monkeypatch.setattr(writer, "WholeTicks", Disk)
    monkeypatch.setattr(writer.time, "monotonic", arrivals.monotonic)
    arrivals.messages.insert(0, (arrivals.now_s, Start(str(part), str(folder / "trial.mcap"), METADATA)))
    writer.TrialWriter(arrivals, None).run()
    return disk


GAPS = st.lists(st.floats(0, 3) | st.just(0.05) | st.sampled_from([0.0, 1.0]), min_size=1, max_size=30)


@settings(max_examples=25)
@given(gaps=GAPS, lines=st.sets(st.integers(0, 29)))
def test_what_was_handed_over_a_second_before_the_cut_is_on_the_disk(gaps, lines, tmp_path_factory):
    folder = tmp_path_factory.mktemp("cut")
    times = [100.0 + passed for passed in itertools.accumulate(gaps)]
    messages = [
        (at_s, LogLine(1, "info", "wind") if number in lines else Step(1, 1, a_step(number), None))
        for number, at_s in enumerate(times)
    ]
    with pytest.MonkeyPatch.context() as monkeypatch:
        disk = write(folder, Arrivals(list(messages)), monkeypatch)
    ends = [at_s for at_s, _ in disk[1:]]
    part = folder / "cut" / "trial.mcap.part"
    part.parent.mkdir()
    for (_, content), cut_s in zip(disk, ends, strict=False):  # the worst moment: just before the next sync
        due = [number for number, at_s in enumerate(times) if at_s < cut_s - MAY_LOSE_S]
        part.write_bytes(content)
        trial = read_trial(part)
        assert {step.step for step in trial.steps} >= {number for number in due if number not in lines}
        assert len(trial.events) >= len(lines.intersection(due))
    assert len(read_trial(folder).steps) == len([n for n in range(len(times)) if n not in lines])


def run(*command):
    return subprocess.run(command, check=True, capture_output=True, text=True)


@contextlib.contextmanager
def mounted(image, at):
    """Mount a file as a file system; where that is not permitted, skip."""
    at.mkdir()
    try:
        run("mount", "-o", "loop,noatime", str(image), str(at))
    except (OSError, subprocess.CalledProcessError) as error:
        pytest.skip(f"no loop device here: {error}")
    try:
        yield at
    finally:
        run("umount", str(at))


@EXHAUSTIVE
@pytest.mark.slow
@pytest.mark.skipif(os.geteuid() != 0, reason="mounting needs root")
@pytest.mark.skipif(not shutil.which("mkfs.ext4"), reason="needs mkfs.ext4")
def test_a_disk_that_is_cut_off_has_all_but_the_last_second(tmp_path, measured):
    chance = random.Random(os.urandom(8))
    image, copy = tmp_path / "disk.img", tmp_path / "cut.img"
    with image.open("wb") as file:
        file.truncate(64 << 20)
    run("mkfs.ext4", "-q", "-F", str(image))
    clock = MonotonicClock()
    with mounted(image, tmp_path / "disk") as disk, a_log(disk, steps=1000) as log:
        pacer = Pacer(clock, 20.0)
        handed_ns = {}
        for number in range(chance.randrange(80, 140)):
            pacer.wait()
            log.step(a_step(number), a_frame(number), an_observation(number))
            handed_ns[number] = clock.now_ns()
        os.kill(log.writer_pid, signal.SIGSTOP)  # the cut: from here on nothing more is written
        cut_ns = clock.now_ns()
        shutil.copyfile(image, copy)
        os.kill(log.writer_pid, signal.SIGCONT)
    with mounted(copy, tmp_path / "after") as after:
        (part,) = after.rglob("trial.mcap.part")
        done = salvage(part)
        steps = [step.step for step in read_trial(done.path).steps]
    assert steps == list(range(len(steps)))
    lost_s = (cut_ns - handed_ns[len(steps)]) / 1e9 if len(steps) < len(handed_ns) else 0.0
    measured(
        f"power cut on ext4: {len(handed_ns) - len(steps)} of {len(handed_ns)} steps, {lost_s:.2f} s lost"
    )
    assert len(steps) > len(handed_ns) / 2  # four seconds at least; without fdatasync nothing at all is there
