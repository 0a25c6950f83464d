"""The operator's ways to stop, through real processes: `stop`, Enter in a terminal, and `--stop-fd`."""

from __future__ import annotations

import contextlib
import os
import pty
import signal
import subprocess
import sys
import threading
from pathlib import Path

import pytest
import yaml

from adatracker_deploy.cli import main
from adatracker_deploy.registry import profile_dir
from adatracker_deploy.runtime.running import PLACE_VARIABLE, folder
from adatracker_deploy.trial.reader import read_trial
from tests.tiers import EXHAUSTIVE, sampled

from .conftest import COMMAND, gone

pytestmark = [pytest.mark.slow, pytest.mark.timeout(120)]

TRIAL = (
    *("--platform", "wheeled", "--sitl", "--segmenter", "truth"),
    *("--profile", "patient.yaml", "--steps", "100000"),
)
FOLLOWING = "following for"


@pytest.fixture(autouse=True)
def own_folder(tmp_path, monkeypatch):
    """Trials of other tests, which run beside this one, are not this one's to stop."""
    monkeypatch.setenv(PLACE_VARIABLE, str(tmp_path))


@pytest.fixture(autouse=True)
def patient(tmp_path):
    """A base that two trials at once on two shared cores do not stop: fewer pictures, more patience."""
    profile = yaml.safe_load((profile_dir() / "scout.yaml").read_text())
    profile["camera"]["rate_hz"] = 10
    profile["connection"]["roles"]["timing"]["feedback_timeout_s"] = 1.0
    (tmp_path / "patient.yaml").write_text(yaml.safe_dump(profile))


@pytest.fixture
def trial(tmp_path):
    """Start a trial, and return it as soon as it follows."""
    with contextlib.ExitStack() as stack:

        def start(*arguments, stdout_until=FOLLOWING, **options):
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
                if stdout_until in line:
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
    os.waitpid(frozen.pid, os.WUNTRACED)  # else, busy, it may take SIGTERM before it stands still
    status, lines = stop(capsys)
    assert (status, len(lines)) == (0, 2)
    assert "did not answer and was killed: its link stops the robot" in lines[0]
    assert frozen.wait() == -signal.SIGKILL
    over = threading.Event()
    while not gone(link):
        over.wait(0.01)


def test_trials_are_found_whatever_the_environment_of_who_stops_them(monkeypatch):
    monkeypatch.delenv(PLACE_VARIABLE)
    found = set()
    for session in ("/run/user/4711", "/nowhere", ""):
        monkeypatch.setenv("XDG_RUNTIME_DIR", session)
        monkeypatch.setenv("TMPDIR", session)
        found.add(folder())
    assert len(found) == 1


@EXHAUSTIVE
def test_one_trial_is_stopped_by_its_log_and_the_other_runs_on(trial, capsys, tmp_path):
    first, second = trial("--log-dir", "one"), trial("--log-dir", "two")
    (log,) = (tmp_path / "one").iterdir()
    assert main(["stop", log.name]) == 0
    assert first.wait() == 130
    assert second.poll() is None
    capsys.readouterr()
    assert main(["stop", "drone"]) == 2
    said = capsys.readouterr().err
    assert "stop drone: no such trial runs; wheeled (process" in said
    assert main(["stop", "wheeled"]) == 0
    assert second.wait() == 130


@EXHAUSTIVE
def test_a_trial_that_ends_by_itself_says_so_and_is_waited_for(trial, tmp_path):
    ending = trial("--steps", "20")
    for line in ending.stdout:
        if line.startswith("disengaging"):
            break
    assert main(["stop"]) == 0
    assert ending.wait() == 130
    (log,) = (tmp_path / "trials").iterdir()
    assert read_trial(log).complete


@EXHAUSTIVE
@pytest.mark.parametrize(
    "number",
    [signal.SIGHUP, *(pytest.param(each, marks=EXHAUSTIVE) for each in (signal.SIGINT, signal.SIGTERM))],
    ids=lambda number: number.name,
)
def test_a_stop_while_a_trial_ends_lets_no_other_begin(trial, number):
    ending = trial("--steps", "20", "--trials", "3", stdout_until="disengaging")
    ending.send_signal(number)
    ending.send_signal(number)
    said = ending.stdout.read()
    assert ending.wait() == 130
    assert "no further trial: a stop was asked for while this one ended" in said
    assert "trial 2 of 3" not in said


def test_a_dropped_terminal_stops_the_robot_in_order(tmp_path):
    pid, terminal = pty.fork()
    if pid == 0:  # pragma: no cover
        os.chdir(tmp_path)
        os.execv(sys.executable, [*COMMAND, *TRIAL])
    said = b""
    while FOLLOWING.encode() not in said:
        said += os.read(terminal, 4096)
    os.close(terminal)  # the kernel sends SIGHUP to the whole foreground group
    _, status = os.waitpid(pid, 0)
    assert os.waitstatus_to_exitcode(status) == 130
    (log,) = (tmp_path / "trials").iterdir()
    trial = read_trial(log)
    assert trial.complete
    assert trial.summary["outcome"] == "interrupted"


@EXHAUSTIVE
def test_a_trial_that_was_asked_to_goes_on_without_its_terminal(tmp_path):
    pid, terminal = pty.fork()
    if pid == 0:  # pragma: no cover
        os.chdir(tmp_path)
        os.execv(sys.executable, [*COMMAND, *TRIAL, "--steps", "60", "--on-hangup", "continue"])
    said = b""
    while FOLLOWING.encode() not in said:
        said += os.read(terminal, 4096)
    os.close(terminal)
    _, status = os.waitpid(pid, 0)
    assert os.waitstatus_to_exitcode(status) == 0
    (log,) = (tmp_path / "trials").iterdir()
    assert read_trial(log).summary["outcome"] == "completed"


def test_a_folder_that_others_can_write_is_refused(tmp_path, capsys):
    (tmp_path / f"adatracker-deploy-{os.getuid()}").mkdir(mode=0o700)
    (tmp_path / f"adatracker-deploy-{os.getuid()}").chmod(0o777)
    assert main(["stop"]) == 2
    assert "not a folder that this user alone can write" in capsys.readouterr().err


@pytest.mark.parametrize("how", sampled(("pressed", "dead"), everyday=("dead",)))
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
    assert os.waitstatus_to_exitcode(status) == 130, said.decode()
    assert b"stopped by the operator" in said


def children(pid):
    return map(int, Path(f"/proc/{pid}/task/{pid}/children").read_text().split())


def name(pid):
    return Path(f"/proc/{pid}/comm").read_text().strip()
