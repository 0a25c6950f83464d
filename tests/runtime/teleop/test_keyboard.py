"""The keys of a real terminal drive while they repeat; the terminal is left as it was."""

from __future__ import annotations

import os
import pty
import termios
import threading

import pytest

from adatracker_deploy.core.clock import MonotonicClock
from adatracker_deploy.runtime.teleop.hand import Hand
from adatracker_deploy.runtime.teleop.keyboard import KEY_HOLD_S, KEYS, SHARE, decode, keyboard


def test_a_drive_key_sets_every_axis_and_is_its_own_dead_man_button():
    assert decode(b"o") == [
        *(("forward", SHARE), ("lateral", 0.0), ("vertical", 0.0), ("yaw", -SHARE)),
        ("dead_man_s", KEY_HOLD_S),
    ]


@pytest.mark.parametrize(
    ("data", "last"),
    [
        (b"g", ("give_back", 1.0)),
        (b"\n", ("stop", 1.0)),
        (b"\r", ("stop", 1.0)),
        (b" ", ("take", 1.0)),
        (b"k", ("take", 1.0)),
        (b"\x1b", ("take", 1.0)),
        (b"\xff", ("take", 1.0)),
        ("ü".encode(), ("take", 1.0)),
    ],
)
def test_other_keys_give_back_stop_or_take_over_and_stand(data, last):
    assert decode(data)[-1] == last
    assert "dead_man_s" not in [code for code, _ in decode(data)]


@pytest.mark.parametrize("data", [b"\x1b[A", b"\x1bOA", b"\x1b[1;5D", b"\x1b[15~", b"\x1b[I"])
def test_no_letter_of_an_escape_sequence_drives(data):
    assert decode(data) == [("take", 1.0)]


def test_no_key_stops_that_also_drives():
    assert not set(KEYS) & {"g", "k", " ", "\r", "\n"}


def test_a_terminal_is_read_key_by_key_its_loss_is_told_and_its_settings_come_back():
    master, terminal = pty.openpty()
    came, stopped = threading.Semaphore(0), threading.Event()
    hand = Hand(MonotonicClock(), stopped.set)

    def put(*events):
        hand.put(*events)
        came.release()

    before = termios.tcgetattr(terminal)
    with keyboard(terminal, put):
        hand.at(MonotonicClock().now_ns())
        os.write(master, b"i")  # no Enter
        assert came.acquire(timeout=10)
        assert hand.at(MonotonicClock().now_ns()).drives
        os.write(master, b"\n")
        assert stopped.wait(10)
        assert not termios.tcgetattr(terminal)[3] & (termios.ICANON | termios.ECHO)
        assert termios.tcgetattr(terminal)[3] & termios.ISIG
    assert termios.tcgetattr(terminal) == before
    gone = threading.Event()
    with keyboard(terminal, lambda *events: gone.set() if events[0][0] == "gone" else None):
        os.close(master)
        assert gone.wait(10)
    os.close(terminal)
