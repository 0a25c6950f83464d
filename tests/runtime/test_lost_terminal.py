"""A terminal that hangs up costs its lines, not the robot."""

from __future__ import annotations

import os
import pty
import sys

import pytest

from adatracker_deploy.runtime.lost_terminal import let_go, tolerated


@pytest.fixture
def terminal():
    """Give both ends of a terminal: the one that hangs up when closed, and the stream a program writes to."""
    far, near = pty.openpty()
    with os.fdopen(near, "w") as stream:
        yield far, stream


def test_lines_are_shown_until_it_hangs_up_and_lost_then(terminal, monkeypatch):
    far, stream = terminal
    monkeypatch.setattr(sys, "stdout", stream)
    with tolerated():
        print("seen")
        shown = b""
        while not shown.endswith(b"\n"):  # a terminal may hand a line over in parts
            shown += os.read(far, 100)
        assert shown == b"seen\r\n"
        assert sys.stdout.isatty()
        os.close(far)
        for _ in range(3):
            print("lost")
        assert not sys.stdout.isatty()


def test_without_it_a_line_is_an_error(terminal):
    far, stream = terminal
    os.close(far)
    with pytest.raises(OSError, match="Input/output"):
        os.write(stream.fileno(), b"lost")
    let_go((stream.fileno(),))  # as when SIGHUP is heard
    print("into nowhere", file=stream, flush=True)


def test_other_outputs_are_left_as_they_are(monkeypatch, tmp_path):
    with (tmp_path / "said").open("w") as file:
        monkeypatch.setattr(sys, "stdout", file)
        with tolerated():
            assert sys.stdout is file
