"""A user-mode kernel runs a command, tells how it ended, and leaves nothing behind."""

from __future__ import annotations

import contextlib
import os
import select
import shutil
import signal
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

from tests.tiers import EXHAUSTIVE
from tests.wheeled.uml import launcher
from tests.wheeled.uml.room import ROOT, TIMED_OUT

pytestmark = pytest.mark.skipif(
    launcher.kernel() is None, reason="user-mode Linux is not installed, or cannot run on this processor"
)


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    """Give the folder that holds each kernel's own folder; check that it is empty after the test."""
    folder = tmp_path / "kernels"
    folder.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(folder))
    yield folder
    assert not processes_in(folder)
    assert not list(folder.iterdir())


def processes_in(folder: Path) -> set[int]:
    """Return the processes at work in the folder: all that a kernel consists of, whoever started it."""
    found = set()
    for process in Path("/proc").glob("[0-9]*"):
        with contextlib.suppress(OSError):  # it ended meanwhile
            if (process / "cwd").readlink().is_relative_to(folder):
                found.add(int(process.name))
    return found


def test_output_and_exit_status_come_back_from_another_kernel():
    ended = launcher.run(["sh", "-c", "uname -r; pwd; echo wrong >&2; exit 7"], limit_s=30.0)
    release, folder, wrong = ended.output.splitlines()
    assert release != os.uname().release
    assert (folder, wrong) == (str(ROOT), "wrong")
    assert ended.status == 7


@EXHAUSTIVE
def test_a_command_killed_by_a_signal_is_told_as_a_shell_tells_it():
    ended = launcher.run(["sh", "-c", "kill -9 $$"], limit_s=30.0)
    assert ended.status == 128 + signal.SIGKILL


@EXHAUSTIVE
def test_more_output_than_any_buffer_holds_comes_back_byte_for_byte():
    ended = launcher.run([sys.executable, "-c", "print('a line\\n' * 40_000, end='')"], limit_s=60.0)
    assert ended.output == "a line\n" * 40_000


@EXHAUSTIVE
def test_arguments_keep_their_spaces_and_quotes():
    ended = launcher.run(["printf", "%s|", "two words", '"', "'", "--", "a=b"], limit_s=30.0)
    assert ended.output == "two words|\"|'|--|a=b|"


@EXHAUSTIVE
def test_a_command_that_does_not_end_is_ended_at_the_limit_and_its_output_kept():
    ended = launcher.run(["sh", "-c", "echo begun; sleep 600"], limit_s=1.0)
    assert (ended.status, ended.output) == (TIMED_OUT, "begun\n")


def test_the_guest_cannot_write_to_the_host(tmp_path):
    ended = launcher.run(["touch", str(tmp_path / "written")], limit_s=30.0)
    assert ended.status == 1
    assert "Read-only file system" in ended.output
    assert not (tmp_path / "written").exists()


@EXHAUSTIVE
def test_a_kernel_that_hangs_is_ended_and_one_that_cannot_start_a_command_says_why(monkeypatch):
    with pytest.raises(launcher.BootError, match="no-such-program"):
        launcher.run(["no-such-program"], limit_s=30.0)
    monkeypatch.setattr(launcher, "BOOT_LIMIT_S", 0.0)
    with pytest.raises(launcher.BootError, match="before its command had"):
        launcher.run(["true"], limit_s=0.3)


@EXHAUSTIVE
def test_the_guest_ends_by_itself_when_its_launcher_is_killed(folder):
    program = "from tests.wheeled.uml.launcher import run; run(['sleep', '600'], limit_s=1.0)"
    environment = {**os.environ, "TMPDIR": str(folder)}
    with subprocess.Popen([sys.executable, "-c", program], cwd=ROOT, env=environment) as launched:
        while not processes_in(folder):
            assert launched.poll() is None
        launched.kill()
    while alive := processes_in(folder):
        with contextlib.suppress(ProcessLookupError), os.fdopen(os.pidfd_open(alive.pop())) as one:
            assert select.select([one], [], [], 60.0)[0]
    shutil.rmtree(next(folder.iterdir()))  # which only the launcher could have done
