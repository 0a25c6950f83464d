"""An operator's mark on a trial is kept beside its log, leaves the log unchanged, and is what is scored."""

from __future__ import annotations

import json
import shutil

import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from adatracker_deploy.cli import main
from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.trial.marks import (
    LONGEST_NOTE,
    VERDICTS,
    Mark,
    add_mark,
    holding,
    marks_path,
    read_marks,
    typed,
)
from tests.report.pages import HOSTILE, Page, write_trial
from tests.trial.records import a_step

AT = "2026-05-01T10:00:00+00:00"


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """A completed trial of 40 steps, two seconds, as it was logged."""
    steps = [a_step(number) for number in range(41)]
    folder = tmp_path_factory.mktemp("recorded") / "trial"
    return write_trial(
        folder, steps, planned=40, summary={"outcome": "completed", "reason": "", "stop_s": 0.3}
    )


@pytest.fixture
def trial(recorded, tmp_path):
    return shutil.copytree(recorded, tmp_path / "trial")


def mark(capsys, *arguments):
    """Return (exit status, stdout, stderr)."""
    status = main(["mark", *map(str, arguments)])
    return status, *capsys.readouterr()


def scored(capsys, trial):
    assert main(["score", str(trial), "--json"]) == 0
    out, err = capsys.readouterr()
    return json.loads(out), err


def test_a_marked_outcome_is_scored_and_the_recorded_one_stays(capsys, trial, recorded):
    status, out, err = mark(capsys, trial, "--outcome", "takeover", "--note", "by the sticks, at the kerb")
    assert (status, err) == (0, "")
    assert out == f"{trial / 'trial.marks.yaml'}: takeover, recorded as completed\n"
    found, err = scored(capsys, trial)
    assert (found["outcome"], found["recorded_outcome"]) == ("takeover", "completed")
    assert (found["reason"], found["el"], found["mr"]) == ("by the sticks, at the kerb", 40, 1.0)
    assert "takeover by the operator's mark, recorded as completed" in err
    assert (trial / "trial.mcap").read_bytes() == (recorded / "trial.mcap").read_bytes()
    assert (trial / "trial.marks.yaml").stat().st_mode & 0o777 == 0o600


def test_a_trial_ends_when_the_mark_says_that_it_did(capsys, trial):
    mark(capsys, trial, "--outcome", "wrong_person", "--since", "1.2")
    found, _ = scored(capsys, trial)
    assert (found["outcome"], found["el"], found["steps"]) == ("wrong_person", 24, 40)
    assert found["seconds"] == pytest.approx(1.2)


def test_the_last_outcome_holds_and_good_takes_the_recorded_one_back(capsys, trial):
    for said, held in (("collision", "collision"), ("takeover", "takeover"), ("good", "completed")):
        mark(capsys, trial, "--outcome", said)
        assert scored(capsys, trial)[0]["outcome"] == held
    assert [one["outcome"] for one in scored(capsys, trial)[0]["marks"]] == ["collision", "takeover", "good"]


def test_a_note_alone_changes_no_outcome(capsys, trial):
    mark(capsys, trial, "--note", "wet grass")
    found, err = scored(capsys, trial)
    assert (found["outcome"], found["reason"], err) == ("completed", "", "")
    assert found["marks"][0]["note"] == "wet grass"


def test_a_mark_moves_the_success_rate_and_what_is_compared(capsys, trial, recorded, tmp_path):
    mark(capsys, trial, "--outcome", "collision")
    assert main(["compare", str(recorded), str(trial), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["differences"]["sr"]["mean"] == {"a": 1.0, "b": 0.0}
    assert main(["score", str(trial), "--csv", str(tmp_path / "t.csv")]) == 0
    assert (tmp_path / "t.csv").read_text().splitlines()[1].endswith(",completed,0.0,True,True,0,,")


def test_a_report_shows_what_was_said_as_text_whatever_it_is(capsys, trial, tmp_path):
    mark(capsys, trial, "--outcome", "takeover", "--note", HOSTILE)
    assert main(["report", str(trial), "--out", str(tmp_path / "page.html")]) == 0
    page = Page((tmp_path / "page.html").read_text())
    assert "The operator's marks" in page.text
    assert "recorded as completed" in page.text
    assert not [name for name, _ in page.tags if name == "script"]
    assert page.addresses() == [] or all(address.startswith("data:") for address in page.addresses())


def test_marks_of_an_unfinished_log_hold_for_what_it_is_salvaged_to(capsys, trial):
    (trial / "trial.mcap").rename(trial / "trial.mcap.part")
    assert mark(capsys, trial, "--outcome", "takeover")[0] == 0
    assert scored(capsys, trial)[0]["outcome"] == "takeover"
    assert main(["salvage", str(trial)]) == 0
    capsys.readouterr()
    assert scored(capsys, trial)[0]["outcome"] == "takeover"


def test_two_logs_in_one_folder_have_marks_of_their_own(capsys, trial):
    shutil.copy(trial / "trial.mcap", trial / "second.mcap")
    mark(capsys, trial / "second.mcap", "--outcome", "takeover")
    assert scored(capsys, trial / "second.mcap")[0]["outcome"] == "takeover"
    assert scored(capsys, trial / "trial.mcap")[0]["outcome"] == "completed"


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ((), "an outcome, a note, or both"),
        (("--outcome", "lost"), "invalid choice: 'lost'"),
        (("--outcome", "takeover", "--since", "2.1"), "--since 2.1: the trial lasted from 0 to 2.0 s"),
        (("--outcome", "takeover", "--since", "nan"), "--since nan"),
        (("--outcome", "good", "--since", "1"), "a mark with a time needs an outcome"),
        (("--note", "x", "--since", "1"), "a mark with a time needs an outcome"),
        (("--note", "x" * 2001), "at most 2000 characters"),
    ],
)
def test_a_mark_that_says_too_little_or_too_much_is_refused(capsys, trial, arguments, words):
    status, out, err = mark(capsys, trial, *arguments)
    assert (status, out, err.count("\n")) == (2, "", 1)
    assert words in err
    assert not (trial / "trial.marks.yaml").exists()


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("marks: [{at: x, outcome: fine}]", "expected one of 'good'"),
        ("marks: [{at: x, outcome: good, since_s: 3}]", "a mark with a time needs an outcome"),
        ("marks: [{at: x}]", "an outcome, a note, or both"),
        ("mark: []", "unknown key 'mark'; did you mean 'marks'?"),
        ("[", "not valid YAML"),
        ("", "expected a mapping"),
        ("marks: [{at: x, outcome: takeover, since_s: .nan}]", "expected a finite number"),
    ],
)
def test_a_file_that_holds_no_marks_is_told_and_never_written_over(capsys, trial, text, words):
    file = trial / "trial.marks.yaml"
    file.write_text(text)
    for command in (["score", str(trial)], ["mark", str(trial), "--outcome", "good"]):
        assert main(command) == 2
        err = capsys.readouterr().err
        assert words in err
        assert err.count(str(file)) == 1
    assert file.read_text() == text


def test_a_folder_that_cannot_be_written_is_told(trial, monkeypatch):
    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("adatracker_deploy.trial.marks.write_file", full)
    with pytest.raises(UsageError, match="cannot be written \\(No space left on device\\)"):
        add_mark(trial / "trial.mcap", Mark(at=AT, outcome="good"))


NOTES = st.text(max_size=60).map(typed)
MARKS = st.one_of(
    st.builds(Mark, at=st.just(AT), outcome=st.sampled_from(VERDICTS), note=NOTES),
    st.builds(Mark, at=st.just(AT), note=NOTES.filter(bool)),
    st.builds(
        Mark, at=st.just(AT), outcome=st.sampled_from(VERDICTS[1:]), since_s=st.floats(0, 1e6), note=NOTES
    ),
)


@settings(max_examples=20)
@given(marks=st.lists(MARKS, min_size=1, max_size=4))
def test_what_was_said_is_read_back_as_it_was_said(tmp_path_factory, marks):
    log = tmp_path_factory.mktemp("said") / "trial.mcap"
    for number, one in enumerate(marks, start=1):
        assert add_mark(log, one) == tuple(marks[:number])
    assert read_marks(log) == tuple(marks)
    assert yaml.safe_load(marks_path(log).read_text())["marks"][-1]["at"] == AT


@given(st.text(max_size=2100) | st.text("\x85\n\u2028\ud800\u202ea", max_size=20))
def test_a_note_is_one_line_that_can_be_printed(text):
    note = typed(text)
    assert note.isprintable()
    assert typed(note) == note
    assert len(note) <= LONGEST_NOTE
    note.encode()


@given(marks=st.lists(MARKS, max_size=6))
def test_what_holds_is_the_last_outcome_unless_that_is_good(marks):
    outcomes = [one.outcome for one in marks if one.outcome]
    held = holding(marks)
    assert (held[0] if held else "good") == (outcomes[-1] if outcomes else "good")
    assert held is None or (held[1] in marks and held[1].outcome == held[0])
