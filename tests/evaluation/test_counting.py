"""Progress passes everything on, and tells of it no more often than somebody wants to read."""

from __future__ import annotations

import re

import pytest

from adatracker_deploy.cli import counting
from adatracker_deploy.cli.counting import counted


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
