"""After a trial the operator is asked how it ended; nothing but the word itself begins the next."""

from __future__ import annotations

import contextlib
import io
import json
import os
import pty
import sys
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from adatracker_deploy.cli import main
from adatracker_deploy.cli.asking import ask
from adatracker_deploy.core.errors import PlatformError, UsageError
from adatracker_deploy.runtime import operator_stop
from adatracker_deploy.scoring.summary import summarise_log
from adatracker_deploy.trial.marks import read_marks
from adatracker_deploy.trial.reader import read_scored
from tests.report.pages import write_trial
from tests.trial.records import a_step

AT = "2026-05-01T10:00:00+00:00"


def asked(*lines, outcome="completed", more=lambda _: True):
    """Answer with these lines, then nothing; return what was said and the questions."""
    left, questions = list(lines), []

    def read(question):
        questions.append(question)
        return left.pop(0) if left else None

    return ask(read, at=AT, outcome=outcome, lasted_s=30.0, more=more), questions


@pytest.mark.parametrize(
    ("lines", "outcome", "since_s", "note", "go_on"),
    [
        (("g", "", "go"), "good", None, "", True),
        (("t", "12.5", "by hand", "go"), "takeover", 12.5, "by hand", True),
        (("W", "", "  at the door ", ""), "wrong_person", None, "at the door", False),
        (("collision", "c", "31", "-1", "x", "30", "", "GO"), "collision", 30.0, "", True),
        (("", "wind", "yes", "go"), None, None, "wind", True),
    ],
)
def test_what_is_typed_becomes_a_mark(lines, outcome, since_s, note, go_on):
    answer, _ = asked(*lines)
    said = answer.mark
    assert (said.outcome, said.since_s, said.note, said.at) == (outcome, since_s, note, AT)
    assert answer.go_on is go_on


def test_enter_all_through_says_nothing_and_ends_the_set():
    answer, questions = asked("", "", "")
    assert (answer.mark, answer.go_on, len(questions)) == (None, False, 3)
    assert "(Enter: completed, as recorded)" in questions[0]


def test_where_there_is_no_next_trial_it_is_not_asked_for():
    seen = []

    def none(outcome):
        seen.append(outcome)
        return False

    answer, questions = asked("t", "", "", "go", more=none)
    assert (answer.go_on, seen) == (False, ["takeover"])
    assert not any("next trial" in question for question in questions)
    asked("g", outcome="lost", more=none)
    assert seen[-1] == "lost"


@given(st.lists(st.text(max_size=4) | st.sampled_from(["g", "t", "w", "c", "go", "", "7"]), max_size=12))
def test_whatever_is_typed_it_comes_to_an_end_and_only_go_goes_on(lines):
    answer, questions = asked(*lines)
    assert len(questions) <= len(lines) + 4
    assert not answer.go_on or "go" in [line.strip().lower() for line in lines]
    assert answer.mark is None or answer.mark.outcome or answer.mark.note


class Rig:
    """The command with trials that end as they are told to, and an operator at a terminal."""

    def __init__(self, monkeypatch, folder):
        self.folder, self.ends, self.ran = folder, [], 0
        monkeypatch.setattr("adatracker_deploy.app.trial_run.run_trial", self._run)
        monkeypatch.setattr(operator_stop, "in_terminal", lambda: True)
        monkeypatch.setattr("adatracker_deploy.runtime.operator_stop.heard", _nobody)
        self._monkeypatch = monkeypatch

    def _run(self, plan, progress, started_s, stop):
        self.ran += 1
        outcome = self.ends.pop(0)
        if isinstance(outcome, Exception):
            raise outcome
        folder = self.folder / f"{self.ran}"
        write_trial(folder, [a_step(n) for n in range(21)], planned=20, frames=False,
                    summary={"outcome": outcome, "reason": ""})  # fmt: skip
        found = summarise_log(read_scored(folder))
        return {key: value for key, value in found.items() if key not in ("marks", "recorded_outcome")}

    def __call__(self, *arguments, ends, typed):
        """Return the exit status; outcomes and marks are left in the folder."""
        self.ends = list(ends)
        self._monkeypatch.setattr("sys.stdin", io.StringIO("".join(f"{line}\n" for line in typed)))
        return main(["--platform", "wheeled", "--log-dir", str(self.folder), *arguments])

    def marks(self, number):
        return read_marks(self.folder / str(number) / "trial.mcap")


def _nobody(stop_fd, **_):
    return contextlib.nullcontext(False)


REAL = ("--camera", "world://simple_room")
"""A robot on its real wire, and a virtual person."""


@pytest.fixture
def rig(monkeypatch, tmp_path):
    return Rig(monkeypatch, tmp_path)


def test_a_real_robot_goes_on_only_when_told_and_what_was_said_is_in_the_results(rig, capsys):
    ends, typed = ["completed"] * 3, ["g", "", "go", "w", "0.5", "a jogger", "go", "", "", ""]
    status = rig(*REAL, "--trials", "3", "--json", ends=ends, typed=typed)
    results = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert (status, rig.ran) == (0, 3)
    assert [row["outcome"] for row in results["trials"]] == ["completed", "wrong_person", "completed"]
    assert [row["el"] for row in results["trials"]] == [20, 10, 20]
    assert [len(rig.marks(number)) for number in (1, 2, 3)] == [1, 1, 0]


@pytest.mark.parametrize(("error", "wanted"), [(UsageError("taken"), 2), (PlatformError("not ready"), 1)])
def test_a_trial_that_cannot_begin_takes_no_result_of_those_before_it(rig, capsys, error, wanted):
    ends = ["completed", "lost", error]
    status = rig("--sitl", "--trials", "4", "--json", ends=ends, typed=[])
    out, err = capsys.readouterr()
    assert (status, rig.ran) == (wanted, 3)
    assert [row["outcome"] for row in json.loads(out.splitlines()[-1])["trials"]] == ["completed", "lost"]
    assert err.splitlines()[-1] == f"adatracker-deploy: {error}"
    assert "1 completed" in err


def test_where_no_trial_began_there_is_no_result(rig, capsys):
    assert rig("--sitl", "--trials", "2", "--json", ends=[UsageError("taken")], typed=[]) == 2
    assert capsys.readouterr().out == ""


@pytest.mark.parametrize(
    ("arguments", "ends", "typed", "ran_and_status"),
    [
        ((*REAL, "--trials", "3"), ["completed"], ["", "", ""], (1, 0)),  # Enter is not go
        ((*REAL, "--trials", "3"), ["completed"], [], (1, 0)),  # nobody is there
        ((*REAL, "--trials", "3"), ["safety_stop"], ["g", "", "go"], (1, 1)),  # a stopped one is the last
        ((*REAL, "--trials", "3"), ["completed"], ["t", "", "", "go"], (1, 1)),  # and one that was taken over
        ((*REAL, "--trials", "3"), ["safety_stop"], ["w", "", "", "go"], (1, 0)),  # whatever it is marked
        ((*REAL, "--trials", "3"), ["interrupted"], ["", "dog", "go"], (1, 130)),
        ((*REAL, "--trials", "2", "--no-ask"), ["completed"] * 2, ["t"], (2, 0)),
        ((*REAL, "--trials", "1"), ["completed"], ["t"], (1, 0)),
        ((*REAL, "--trials", "1", "--ask"), ["completed"], ["t"], (1, 1)),
        (("--sitl", "--trials", "2"), ["completed"] * 2, ["t"], (2, 0)),
        (("--sitl", "--trials", "2", "--ask"), ["safety_stop", "lost"], ["", "", "go", ""], (2, 1)),
        (("--dry-run", *REAL, "--trials", "2"), ["completed"] * 2, ["t"], (2, 0)),
    ],
)
def test_who_is_asked_and_what_may_follow(rig, arguments, ends, typed, ran_and_status):
    status = rig(*arguments, ends=ends, typed=typed)
    assert (rig.ran, status) == ran_and_status
    asks = "--ask" in arguments or "3" in arguments
    noted = any(line not in ("", "go") for line in typed)
    assert bool(rig.marks(rig.ran)) == (noted and asks)


def test_without_a_terminal_nobody_is_asked(rig, monkeypatch):
    monkeypatch.setattr(operator_stop, "in_terminal", lambda: False)
    assert rig(*REAL, "--trials", "2", ends=["completed"] * 2, typed=["t"]) == 0
    assert (rig.ran, rig.marks(1)) == (2, ())


def test_a_mark_that_cannot_be_written_costs_a_line_not_the_result(rig, capsys, monkeypatch):
    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("adatracker_deploy.trial.marks.write_file", full)
    status = rig(*REAL, "--trials", "2", "--json", ends=["completed"] * 2, typed=["c", "", "", "go"])
    out, err = capsys.readouterr()
    assert (status, rig.ran) == (0, 2)
    assert "the mark is lost" in " ".join(err.split())
    assert json.loads(out)["outcomes"] == {"completed": 2}


def test_an_interrupt_at_a_question_ends_the_set_and_shows_what_was(rig, capsys, monkeypatch):
    def interrupt():
        raise KeyboardInterrupt

    monkeypatch.setattr("builtins.input", interrupt)
    assert rig(*REAL, "--trials", "3", "--json", ends=["completed"] * 3, typed=[]) == 0
    assert (rig.ran, json.loads(capsys.readouterr().out)["outcomes"]) == (1, {"completed": 1})


def test_at_a_terminal_what_was_typed_before_a_question_is_forgotten(tmp_path):
    pid, terminal = pty.fork()
    if pid == 0:  # pragma: no cover
        os.chdir(Path(__file__).parents[1])
        os.execv(sys.executable, [sys.executable, "-m", "tests.operated", str(tmp_path / "trials")])
    said = b""

    def until(text):
        nonlocal said
        while text not in said:
            said += os.read(terminal, 4096)
        said = said.partition(text)[2]

    def answer(question, line):
        until(question)
        os.write(terminal, line)

    for number in (1, 2):
        until(f"over-{number}".encode())
        os.write(terminal, b"xyz")  # without Enter, which would stop the trial
        until(b"xyz")  # as the terminal echoes what it took
        (tmp_path / f"over-{number}").touch()
        answer(b"as recorded): ", b"w\n")
        answer(b"(Enter: its end): ", b"0.5\n")
        answer(b"note (Enter: none): ", "ein Jogger, s\u00fc\u00df\n".encode())
        answer(b"end the set): ", b"go\n" if number == 1 else b"\n")
    with contextlib.suppress(OSError):  # how a terminal ends
        while os.read(terminal, 4096):
            pass
    _, status = os.waitpid(pid, 0)
    os.close(terminal)
    assert os.waitstatus_to_exitcode(status) == 0
    for number in (1, 2):
        (said_mark,) = read_marks(tmp_path / "trials" / str(number) / "trial.mcap")
        assert (said_mark.outcome, said_mark.since_s) == ("wrong_person", 0.5)
        assert said_mark.note == "ein Jogger, s\u00fc\u00df"
    assert not (tmp_path / "trials" / "3").exists()
