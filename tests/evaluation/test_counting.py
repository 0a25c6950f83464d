"""Progress passes everything on, and tells of it no more often than somebody wants to read."""

from __future__ import annotations

import re

import pytest

from adatracker_deploy.cli import counting
from adatracker_deploy.cli.counting import Count, counted


def test_parts_come_through_in_order_and_short_work_is_silent(capsys):
    assert list(counted(iter("abc"), 3, "letters")) == ["a", "b", "c"]
    assert capsys.readouterr() == ("", "")


def test_long_work_tells_how_far_it_is_on_stderr(capsys, monkeypatch):
    monkeypatch.setattr(counting, "LINE_EVERY_S", 0.0)
    assert list(counted(range(3), 3, "letters")) == [0, 1, 2]
    out, err = capsys.readouterr()
    assert out == ""
    lines = err.splitlines()
    assert [line.split(",")[0] for line in lines] == ["1 of 3 letters", "2 of 3 letters", "3 of 3 letters"]
    assert all(re.search(r", [\d.]+/s, \d+ s left$", line) for line in lines)


def test_a_failure_of_the_work_is_the_failure_that_is_seen():
    def failing():
        yield 1
        raise OSError("broken")

    with pytest.raises(OSError, match="broken"):
        list(counted(failing(), 2, "letters"))


def test_resumed_work_is_as_fast_as_what_is_done_now(capsys):
    seconds = iter((0.0, 20.0, 25.0, 120.0))
    with Count("updates", now_s=lambda: next(seconds)) as count:
        count(9000, 10_000, ", loss 0.500")
        count(9005, 10_000, ", loss 0.490")  # too soon
        count.say("round 2")
        count(9100, 10_000, ", loss 0.250")
    assert capsys.readouterr().err.splitlines() == [
        "9000 of 10000 updates, loss 0.500",
        "round 2",
        "9100 of 10000 updates, loss 0.250, 1.00/s, 15 min left",
    ]


def test_a_terminal_has_one_line_that_changes_and_ends(capsys, monkeypatch):
    monkeypatch.setattr("sys.stderr.isatty", lambda: True)
    seconds = iter((0.0, 1.0, 1.1, 1.15))
    with Count("steps", begun=0, now_s=lambda: next(seconds)) as count:
        for done in (100, 110, 200):
            count(done, 200)
    shown = capsys.readouterr().err
    assert [line.rstrip() for line in shown.split("\r")] == [
        "",
        "100 of 200 steps, 100/s, 1 s left",
        "200 of 200 steps, 174/s, 0 s left",
    ]
    assert shown.endswith("\n")
