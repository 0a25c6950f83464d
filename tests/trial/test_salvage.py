"""Unfinished logs: what was flushed is there again, in a file that every reader takes."""

from __future__ import annotations

import contextlib
import os
import random
import signal

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader

from adatracker_deploy.cli import main
from adatracker_deploy.core.errors import PlatformError, UsageError
from adatracker_deploy.trial.reader import read_trial
from adatracker_deploy.trial.salvage import salvage, salvage_all
from tests.trial.records import a_frame, a_log, a_step, a_trial, an_observation

KILLS = int(os.environ.get("ADATRACKER_KILLS", "5"))
"""How often the writer is killed; ADATRACKER_KILLS=50 for a longer look."""


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """The bytes of a finished log of eight steps."""
    folder = a_trial(tmp_path_factory.mktemp("whole"), [a_step(number) for number in range(8)])
    return (folder / "trial.mcap").read_bytes()


def a_part(folder, data):
    folder.mkdir(parents=True, exist_ok=True)
    part = folder / "trial.mcap.part"
    part.write_bytes(data)
    return part


def messages(path):
    """Read a file with the library's own reader, which needs its index."""
    with path.open("rb") as stream:
        return [
            (channel.topic, message.sequence, message.log_time, message.data)
            for _, channel, message in make_reader(stream).iter_messages(log_time_order=False)
        ]


@settings(max_examples=20)
@given(cut=st.floats(0.55, 1))
def test_wherever_a_log_is_cut_every_whole_record_is_salvaged(whole, tmp_path_factory, cut):
    folder = tmp_path_factory.mktemp("cut")
    part = a_part(folder, whole[: round(cut * len(whole))])
    steps = read_trial(part).steps
    done = salvage(part)
    assert read_trial(done.path).steps == steps
    assert done.steps == len(steps)
    original = a_part(folder / "original", whole)
    assert messages(done.path) == messages(original)[: len(messages(done.path))]
    assert [file.name for file in folder.iterdir() if file.is_file()] == ["trial.mcap"]


@pytest.mark.parametrize("tail", [bytes(1000), b"\xff" * 100, b"\x05\x00"])
def test_what_a_power_cut_left_behind_the_last_record_does_no_harm(whole, tmp_path, tail):
    last = whole.rindex(b"\x0c")  # within the index, far behind the last tick
    done = salvage(a_part(tmp_path, whole[:last] + tail))
    assert done.steps == 8
    assert read_trial(done.path).complete


def test_a_log_that_only_lacked_its_name_loses_nothing(whole, tmp_path):
    done = salvage(a_part(tmp_path, whole))
    assert done.lost_bytes == 0
    assert messages(done.path) == messages(a_part(tmp_path / "original", whole))
    assert read_trial(done.path).summary == {"outcome": "completed"}
    assert done.path.stat().st_mode & 0o777 == 0o600


def test_a_log_that_is_being_written_is_left_alone(tmp_path):
    with a_log(tmp_path) as log:
        with pytest.raises(UsageError, match="still being written"):
            salvage(log.folder / "trial.mcap.part")
        log.step(a_step(0), a_frame(0), an_observation(0))
    assert len(read_trial(log.folder).steps) == 1


def test_a_salvage_that_was_itself_cut_off_is_done_again(whole, tmp_path):
    part = a_part(tmp_path, whole[:-100])
    salvage(part)
    a_part(tmp_path, whole[:-100])
    (tmp_path / "trial.mcap.salvaging").write_bytes(b"half")
    assert salvage(part).steps == 8
    assert [file.name for file in tmp_path.iterdir()] == ["trial.mcap"]


def test_another_finished_log_is_not_overwritten(whole, tmp_path):
    part = a_part(tmp_path, whole)
    (tmp_path / "trial.mcap").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(UsageError, match="beside it already"):
        salvage(part)
    assert part.read_bytes() == whole


@pytest.mark.parametrize("data", [b"", b"\x89MCAP0\r\n", b"something else altogether"])
def test_what_is_no_trial_stays_as_it_is(tmp_path, data):
    part = a_part(tmp_path, data)
    with pytest.raises(UsageError, match="cannot be salvaged"):
        salvage(part)
    assert [file.name for file in tmp_path.iterdir()] == ["trial.mcap.part"]
    assert part.read_bytes() == data


def test_the_original_stays_when_the_new_file_cannot_be_written(whole, tmp_path, monkeypatch):
    part = a_part(tmp_path, whole[:-100])

    def full(_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(UsageError, match="No space left"):
        salvage(part)
    assert [file.name for file in tmp_path.iterdir()] == ["trial.mcap.part"]
    assert part.read_bytes() == whole[:-100]


def test_the_next_run_salvages_what_is_in_its_folder_and_says_so_in_a_line_each(whole, tmp_path):
    a_part(tmp_path / "a", whole[:-100])
    a_part(tmp_path / "b", b"")
    lines = list(salvage_all(tmp_path))
    assert lines[0] == f"salvaged {tmp_path / 'a'}: the log of 8 steps was unfinished"
    assert lines[1].startswith("warning: ")
    assert read_trial(tmp_path / "a").complete


def test_a_run_salvages_before_its_first_trial(whole, tmp_path, capsys, monkeypatch):
    def no_robot(*_):
        assert (tmp_path / "old" / "trial.mcap").exists()
        raise PlatformError("no robot here")

    monkeypatch.setattr("adatracker_deploy.app.trial_run.run_trial", no_robot)
    a_part(tmp_path / "old", whole[:-100])
    assert main(["--platform", "wheeled", "--sitl", "--log-dir", str(tmp_path)]) == 1
    assert capsys.readouterr().out.splitlines()[0].startswith(f"salvaged {tmp_path / 'old'}: ")


def test_the_command_salvages_a_file_or_a_folder_and_score_works_on_it(whole, tmp_path, capsys):
    for name in ("a", "b"):
        a_part(tmp_path / name, whole[: len(whole) * 3 // 4])
    assert main(["salvage", str(tmp_path / "a" / "trial.mcap.part")]) == 0
    assert main(["salvage", str(tmp_path)]) == 0
    assert main(["score", str(tmp_path), "--json"]) == 0
    assert "steps" in capsys.readouterr().out


@pytest.mark.parametrize("path", [".", "finished.mcap"])
def test_with_nothing_to_salvage_it_says_so_and_all_is_well(tmp_path, capsys, monkeypatch, path):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "finished.mcap").write_bytes(b"")
    assert main(["salvage", path]) == 0
    assert capsys.readouterr() == (f"{path}: nothing to salvage: no log here is unfinished\n", "")
    assert main(["salvage", path, "--json"]) == 0
    assert capsys.readouterr().out == '{"salvaged": []}\n'


@pytest.mark.parametrize("wrong", ["nowhere", "notes.txt"])
def test_what_is_no_log_cannot_be_salvaged(tmp_path, capsys, monkeypatch, wrong):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "notes.txt").write_bytes(b"")
    assert main(["salvage", wrong]) == 2
    assert capsys.readouterr().err.count("\n") == 1


@pytest.mark.slow
def test_a_writer_killed_at_any_moment_leaves_every_step_that_it_flushed(tmp_path, capsys):
    chance = random.Random(os.urandom(8))
    for _ in range(KILLS):
        with a_log(tmp_path, steps=1000) as log:
            part = log.folder / "trial.mcap.part"
            for number in range(chance.randrange(1, 200)):
                log.step(a_step(number), a_frame(number), an_observation(number))
            flushed = read_trial(part).steps
            os.kill(log.writer_pid, signal.SIGKILL)
            with contextlib.suppress(ProcessLookupError):
                os.waitid(os.P_PID, log.writer_pid, os.WEXITED | os.WNOWAIT)
            done = salvage(part)
        steps = read_trial(done.path).steps
        assert steps[: len(flushed)] == flushed
        assert [step.step for step in steps] == list(range(len(steps)))
        assert main(["score", str(log.folder)]) == 0
    capsys.readouterr()
