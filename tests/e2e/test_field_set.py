"""A set of trials with an operator at its terminal, and what can be made of its logs afterwards."""

from __future__ import annotations

import contextlib
import json
import os
import pty
import sys

import pytest

from adatracker_deploy.cli import main
from tests.tiers import EXHAUSTIVE

from .conftest import COMMAND

pytestmark = [pytest.mark.slow, pytest.mark.timeout(150), EXHAUSTIVE]

SET = ("--platform", "wheeled", "--sitl", "--segmenter", "truth", "--trials", "2", "--steps", "30", "--ask")
ANSWERS = {
    b"how did it end?": b"w\n",
    b"since which second": b"1\n",
    b"note (Enter": b"a jogger\n",
    b"the next trial?": b"go\n",
}


@pytest.fixture(scope="module")
def operated(tmp_path_factory):
    """The folder of the set's trials, its exit status, and all that stood on the terminal."""
    folder = tmp_path_factory.mktemp("field")
    pid, terminal = pty.fork()
    if pid == 0:  # pragma: no cover
        os.chdir(folder)
        os.execv(sys.executable, [*COMMAND, *SET])
    said, unread = b"", b""
    with contextlib.suppress(OSError):  # how a terminal ends
        while piece := os.read(terminal, 4096):
            said, unread = said + piece, unread + piece
            for question, answer in ANSWERS.items():
                if question in unread and unread.rstrip(b" ").endswith(b":"):
                    unread = b""
                    os.write(terminal, answer)
    _, status = os.waitpid(pid, 0)
    os.close(terminal)
    return folder / "trials", os.waitstatus_to_exitcode(status), said


def the_trials(capsys, folder):
    assert main(["trials", str(folder), "--json"]) == 0
    return json.loads(capsys.readouterr().out)["trials"]


def test_both_trials_ran_and_are_listed_as_they_were_marked(operated, capsys):
    folder, status, said = operated
    rows = the_trials(capsys, folder)
    assert status == 0, said
    assert [row["outcome"] for row in rows] == ["wrong_person"] * 2, said
    assert [row["notes"] for row in rows] == [["a jogger"]] * 2
    assert all(row["el"] < 30 and row["seconds"] <= 1 for row in rows)
    assert said.count(b"Enter or Ctrl-C stops") == 2


def test_the_policy_answers_each_again_to_the_bit(operated, capsys, measured):
    for row in the_trials(capsys, operated[0]):
        status = main(["replay", row["trial"], "--profile", "scout", "--json"])
        found = json.loads(capsys.readouterr().out)
        assert (status, found["equal"], found["same_policy"], found["gap"]) == (0, True, True, None)
        assert found["compared"] + found["idle"] == 31
        gate = found["gate"]
        assert (gate["limits"], gate["trial"]["stop"]) == ({}, None)
        off = gate["agreement"]["vx"]["mean"]
        measured(f"gate judged again from the log: vx off by {off:.3f} m/s in the mean")
        assert off < 0.3  # of at most 1.5: the slots' places between ticks are not known


def test_each_says_the_seed_that_its_policy_was_reset_with(operated, capsys):
    seeds = []
    for row in the_trials(capsys, operated[0]):
        assert main(["score", row["trial"], "--json"]) == 0
        seeds.append(json.loads(capsys.readouterr().out)["episode"]["seed"])
    assert seeds == [0, 1]
