"""``adatracker-deploy trials``: every trial has a line, whatever became of it."""

from __future__ import annotations

import csv
import io
import json

import pytest

from adatracker_deploy.cli import main
from adatracker_deploy.scoring import index as index_module
from adatracker_deploy.scoring.index import index
from tests.report.pages import write_trial
from tests.trial.records import a_log, a_step, a_trial

SUMMARY = {"outcome": "lost", "reason": "", "stop_s": None, "mr": 0.25, "el": 7, "steps": 60, "seconds": 0.4}


def listed(capsys, *arguments):
    """Return (exit status, stdout, stderr)."""
    status = main(["trials", *map(str, arguments)])
    return status, *capsys.readouterr()


def a_written_trial(folder, summary=SUMMARY):
    """A trial of ten steps, with the summary beside its log."""
    write_trial(folder, [a_step(number) for number in range(11)], summary=summary, planned=10, frames=False)
    if summary is not None:
        (folder / "summary.json").write_text(json.dumps(summary))
    return folder


def test_a_row_says_when_what_and_how_it_ended(tmp_path):
    a_written_trial(tmp_path / "a")
    (row,) = index(tmp_path)
    assert row["started"] == "2027-01-15T08:00:00+00:00"
    assert (row["platform"], row["kind"], row["policy"]) == ("drone", "sitl", "pid")
    assert (row["outcome"], row["mr"], row["el"], row["steps"]) == ("lost", 0.25, 7, 60)
    assert (row["seconds"], row["notes"], row["error"]) == (0.4, [], None)
    assert row["bytes"] == (tmp_path / "a" / "trial.mcap").stat().st_size
    assert row["trial"] == str(tmp_path / "a")


@pytest.mark.parametrize("summary", ["", "[]", '{"outcome": "lost"}', None])
def test_without_a_whole_summary_beside_it_the_log_is_scored(tmp_path, summary):
    a_written_trial(tmp_path / "a")
    (tmp_path / "a" / "summary.json").unlink()
    if summary is not None:
        (tmp_path / "a" / "summary.json").write_text(summary)
    (row,) = index(tmp_path)
    assert (row["outcome"], row["mr"], row["el"], row["steps"]) == ("lost", 1.0, 10, 10)


def test_a_mark_shows_with_its_note_and_cuts_where_it_says(tmp_path, capsys):
    trial = a_written_trial(tmp_path / "a")
    main(["mark", str(trial), "--outcome", "takeover", "--note", "at the\nkerb"])
    (row,) = index(tmp_path)
    assert (row["outcome"], row["recorded_outcome"], row["mr"]) == ("takeover", "lost", 0.25)
    main(["mark", str(trial), "--outcome", "wrong_person", "--since", "0.25"])
    (row,) = index(tmp_path)
    assert (row["outcome"], row["el"], row["mr"], row["notes"]) == ("wrong_person", 5, 1.0, ["at the kerb"])
    capsys.readouterr()
    out = listed(capsys, tmp_path)[1].splitlines()
    assert "wrong_person, marked" in out[1]
    assert out[2] == "    at the kerb"


def test_trials_are_listed_by_time_and_those_that_cannot_be_read_with_a_line(tmp_path, capsys):
    a_written_trial(tmp_path / "z")
    for name in ("garbage", "hollow"):
        (tmp_path / name).mkdir()
    (tmp_path / "garbage" / "trial.mcap").write_bytes(b"nothing of the kind")
    (tmp_path / "hollow" / "trial.mcap.part").write_bytes(b"\x89MCAP0\r\n")
    marked = a_written_trial(tmp_path / "y")
    (marked / "trial.marks.yaml").write_text("marks: 5")
    status, out, err = listed(capsys, tmp_path, "--json")
    rows = json.loads(out)["trials"]
    assert (status, err, len(rows)) == (0, "", 4)
    assert [row["started"] for row in rows] == sorted(row["started"] for row in rows)
    errors = {row["trial"].rpartition("/")[2]: row["error"] for row in rows}
    assert errors.pop("z") is None
    for name, words in (
        ("garbage", "not an MCAP file"),
        ("hollow", "does not name its trial"),
        ("y", "expected a list"),
    ):
        assert words in errors[name]
    _, out, _ = listed(capsys, tmp_path)
    assert out.count("cannot be read: ") == 3
    assert out.splitlines()[-1].startswith("4 trials, ")
    assert out.splitlines()[-1].endswith("; 3 cannot be read")


def test_a_log_that_is_being_written_is_no_fault_yet_and_one_that_was_left_is(tmp_path):
    with a_log(tmp_path) as log:
        (row,) = index(tmp_path)
        assert (row["outcome"], row["mr"], row["error"]) == (None, None, None)
        assert row["platform"] == "drone"
    (tmp_path / log.folder.name / "trial.mcap").rename(tmp_path / log.folder.name / "trial.mcap.part")
    (row,) = index(tmp_path)
    assert row["outcome"] == "system_fault"


def test_a_log_that_is_being_written_cannot_be_marked(tmp_path, capsys):
    with a_log(tmp_path) as log:
        assert main(["mark", str(log.folder), "--outcome", "good"]) == 2
        assert "still being written" in capsys.readouterr().err


def test_a_log_by_the_real_writer_is_listed_as_it_was_summed_up(tmp_path):
    a_trial(tmp_path, [a_step(number) for number in range(6)], SUMMARY)
    (row,) = index(tmp_path)
    assert (row["mr"], row["outcome"], row["error"]) == (0.25, "lost", None)


def test_what_is_beside_a_log_is_enough_and_the_log_is_not_read_through(tmp_path, monkeypatch):
    a_written_trial(tmp_path / "a")
    monkeypatch.setattr(index_module, "read_scored", None)
    assert index(tmp_path)[0]["error"] is None


def test_csv_is_a_line_a_trial(tmp_path, capsys):
    a_written_trial(tmp_path / "a")
    main(["mark", str(tmp_path / "a"), "--note", 'said "slow", twice'])
    capsys.readouterr()
    status, out, _ = listed(capsys, tmp_path, "--csv")
    (row,) = csv.DictReader(io.StringIO(out))
    assert (status, row["notes"], row["mr"], row["error"]) == (0, 'said "slow", twice', "0.25", "")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [(["nowhere"], "no such folder"), (["."], "no trials in it"), ([".", "--json", "--csv"], "not allowed")],
)
def test_where_there_is_nothing_to_list_it_exits_with_2(tmp_path, capsys, monkeypatch, arguments, words):
    monkeypatch.chdir(tmp_path)
    status, out, err = listed(capsys, *arguments)
    assert (status, out, err.count("\n")) == (2, "", 1)
    assert words in err


def test_a_trial_whose_timing_was_not_kept_is_listed_as_late(tmp_path, capsys):
    a_written_trial(tmp_path / "a", SUMMARY | {"timing_kept": False})
    a_written_trial(tmp_path / "b", SUMMARY | {"timing_kept": True})
    a_written_trial(tmp_path / "c")  # of a version that did not say it
    _, out, _ = listed(capsys, tmp_path)
    assert [line.count("lost, late") for line in out.splitlines()[1:4]] == [1, 0, 0]
