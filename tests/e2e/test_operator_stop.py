"""The operator's ways to stop, through real processes: `stop`, Enter in a terminal, and `--stop-fd`."""

from __future__ import annotations

import contextlib
import os
import pty
import signal
import subprocess
import sys
import tempfile
import threading
from pathlib import Path

import pytest

from adatracker_deploy.cli import main

from .conftest import COMMAND, gone

pytestmark = [pytest.mark.slow, pytest.mark.timeout(120)]

TRIAL = ("--platform", "wheeled", "--sitl", "--steps", "100000")
FOLLOWING = "following for"


@pytest.fixture(autouse=True)
def own_folder(tmp_path, monkeypatch):
    """Trials of other tests, which run beside this one, are not this one's to stop."""
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))


@pytest.fixture
def trial(tmp_path):
    """Start a trial, and return it as soon as it follows."""
    with contextlib.ExitStack() as stack:

        def start(*arguments, **options):
            process = stack.enter_context(
                subprocess.Popen(
                    [*COMMAND, *TRIAL, *arguments],
                    cwd=tmp_path,
                    stdin=subprocess.DEVNULL,
                    stdout=subprocess.PIPE,
                    stderr=subprocess.STDOUT,
                    text=True,
                    **options,
                )
            )
            stack.callback(process.kill)
            said = []
            for line in process.stdout:
                said.append(line)
                if FOLLOWING in line:
                    return process
            return pytest.fail("".join(said))

        yield start


def stop(capsys):
    status = main(["stop"])
    return status, capsys.readouterr().out.splitlines()


def test_where_nothing_runs_that_is_said(capsys, tmp_path):
    assert stop(capsys) == (1, ["nothing runs"])
    folder = tmp_path / f"adatracker-deploy-{os.getuid()}"
    (folder / str(os.getpid())).write_text("12345\nwheeled\n")  # this process, but another start: left behind
    assert stop(capsys) == (1, ["nothing runs"])
    assert not list(folder.iterdir())


def test_every_trial_stops_in_order(trial, capsys):
    trials = [trial(), trial()]
    status, lines = stop(capsys)
    assert status == 0
    assert sorted(lines[:-1]) == sorted(f"wheeled (process {each.pid}) stops" for each in trials)
    assert lines[-1].startswith("ended after ")
    for each in trials:
        assert "stopped by the operator" in each.stdout.read()
        assert each.wait() == 130
    assert stop(capsys)[0] == 1


def test_a_trial_that_does_not_answer_is_killed(trial, capsys):
    frozen = trial()
    link = next(pid for pid in children(frozen.pid) if name(pid) == "adatracker-link")
    os.kill(frozen.pid, signal.SIGSTOP)
    status, lines = stop(capsys)
    assert (status, len(lines)) == (0, 2)
    assert "did not answer and was killed: its link stops the robot" in lines[0]
    assert frozen.wait() == -signal.SIGKILL
    over = threading.Event()
    while not gone(link):
        over.wait(0.01)


def test_without_a_runtime_folder_the_temporary_one_serves(capsys, tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path / "missing"))
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    assert stop(capsys) == (1, ["nothing runs"])
    assert (tmp_path / f"adatracker-deploy-{os.getuid()}").is_dir()


def test_a_folder_that_others_can_write_is_refused(tmp_path, capsys):
    (tmp_path / f"adatracker-deploy-{os.getuid()}").mkdir(mode=0o700)
    (tmp_path / f"adatracker-deploy-{os.getuid()}").chmod(0o777)
    assert main(["stop"]) == 2
    assert "not a folder of this user alone" in capsys.readouterr().err


@pytest.mark.parametrize("how", ["pressed", "dead"])
def test_a_hook_stops_by_a_byte_and_by_dying(trial, how):
    end, hook = os.pipe()
    running = trial("--stop-fd", str(end), pass_fds=(end,))
    os.close(end)
    if how == "pressed":
        os.write(hook, b"!")
    else:
        os.close(hook)
    assert "stopped by the operator" in running.stdout.read()
    assert running.wait() == 130
    if how == "pressed":
        os.close(hook)


def test_a_descriptor_that_cannot_be_read_is_refused_before_anything_moves(tmp_path):
    done = subprocess.run(
        [*COMMAND, *TRIAL, "--stop-fd", "77"], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stderr) == (
        2,
        "adatracker-deploy: --stop-fd 77: is not open for reading\n",
    )
    assert not (tmp_path / "trials").exists()


def test_enter_stops_in_a_terminal(tmp_path):
    pid, terminal = pty.fork()
    if pid == 0:  # pragma: no cover
        os.chdir(tmp_path)
        os.execv(sys.executable, [*COMMAND, *TRIAL])
    said = b""
    with contextlib.suppress(OSError):  # how a terminal ends
        while True:
            said += os.read(terminal, 4096)
            if FOLLOWING.encode() in said and b"Enter" in said:
                os.write(terminal, b"\n")
                break
        while True:
            said += os.read(terminal, 4096)
    _, status = os.waitpid(pid, 0)
    os.close(terminal)
    assert os.waitstatus_to_exitcode(status) == 130
    assert b"stopped by the operator" in said


def children(pid):
    return map(int, Path(f"/proc/{pid}/task/{pid}/children").read_text().split())


def name(pid):
    return Path(f"/proc/{pid}/comm").read_text().strip()
