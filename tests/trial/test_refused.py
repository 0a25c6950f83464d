"""Logs of somebody else, which may not be read, are said to be that, and are not taken for none."""

from __future__ import annotations

import os
import shutil
import tempfile
from pathlib import Path

import pytest

from adatracker_deploy.cli import main
from tests.report.pages import write_trial
from tests.trial.records import a_step

NOBODY = 65534


@pytest.fixture
def theirs():
    """Two trials: a folder that is closed, and one with a log that is."""
    folder = Path(tempfile.mkdtemp())  # pytest's own folders are closed themselves
    folder.chmod(0o755)
    for name in ("a", "b"):
        write_trial(folder / name, [a_step(step) for step in range(5)], summary={"outcome": "lost"})
    yield folder
    shutil.rmtree(folder)


@pytest.fixture
def closed(theirs, capsys, tmp_path):
    """Close them to whoever runs this, who becomes nobody for that if need be."""
    for command in (*COMMANDS, ("trials",)):  # so that every module is imported while it can be
        main([*command, str(theirs / "a")])
    capsys.readouterr()
    (theirs / "a").chmod(0o700 if os.geteuid() == 0 else 0)
    (theirs / "b" / "trial.mcap").chmod(0o600 if os.geteuid() == 0 else 0)
    before = os.geteuid()
    if before == 0:
        os.seteuid(NOBODY)
    yield theirs
    os.seteuid(before)
    (theirs / "a").chmod(0o700)


COMMANDS = (
    ("score",),
    ("report", "--out", os.devnull),
    ("mark", "--note", "x"),
    ("filmstrip", "--out", os.devnull),
    ("replay",),
)


@pytest.mark.parametrize("command", COMMANDS, ids=lambda command: command[0])
@pytest.mark.parametrize("name", ["a", "b"])
def test_a_log_that_may_not_be_read_is_told_in_one_line_with_its_name(closed, capsys, command, name):
    assert main([*command, str(closed / name)]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.count("\n") == 1
    assert str(closed / name) in err
    assert "Permission denied" in err or "may not be read" in err


@pytest.mark.parametrize("command", [("score",), ("report", "--out", os.devnull)], ids=["score", "report"])
def test_a_folder_of_them_is_not_taken_for_one_without_trials(closed, capsys, command):
    assert main([*command, str(closed)]) == 2
    err = capsys.readouterr().err
    assert "no trials in it" not in err
    assert err.count("Permission denied") == 2


def test_they_are_listed_with_the_reason(closed, capsys):
    assert main(["trials", str(closed)]) == 0
    out = capsys.readouterr().out
    assert out.count("cannot be read: ") == 2
    assert out.count("Permission denied") == 2
