"""Finds what an operator drives with, and opens it for a trial."""

from __future__ import annotations

import contextlib
import os
import signal
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.runtime.operator_stop import in_terminal
from adatracker_deploy.runtime.teleop.event_file import read_events
from adatracker_deploy.runtime.teleop.hand import Hand

if TYPE_CHECKING:
    from collections.abc import Iterator

    from adatracker_deploy.core.clock import Clock

GAMEPAD, KEYBOARD = "gamepad", "keyboard"


def is_gamepad(device: str) -> bool:
    """Return whether this names a gamepad: the only one, or one by its path."""
    return device == GAMEPAD or device.startswith("/dev/")


def check(device: str) -> None:
    """Check that there is what an operator wants to drive with.

    Args:
        device: ``gamepad``, ``/dev/input/eventN``, ``keyboard``, or a file of events.

    Raises:
        UsageError: there is not.
    """
    if device == KEYBOARD:
        if not in_terminal():
            raise UsageError("--teleop keyboard needs a terminal in the foreground: standard input is none")
    elif is_gamepad(device):
        from adatracker_deploy.runtime.teleop.gamepad import find_gamepad, gamepad

        with gamepad(find_gamepad() if device == GAMEPAD else device, lambda *_: None):
            pass
    else:
        read_events(Path(device))


@contextlib.contextmanager
def opened(device: str, clock: Clock, *, alone: bool) -> Iterator[Hand]:
    """Open what an operator drives with; its stop button ends the trial as Ctrl-C does.

    Args:
        device: as for `check`.
        clock: the run's.
        alone: there is no policy to give back to.

    Raises:
        UsageError: it cannot be opened.
    """
    if device == KEYBOARD:
        from adatracker_deploy.runtime.teleop.keyboard import keyboard

        check(device)
        hand = Hand(clock, _interrupt, alone=alone)
        with keyboard(sys.stdin.fileno(), hand.put):
            yield hand
    elif is_gamepad(device):
        from adatracker_deploy.runtime.teleop.gamepad import find_gamepad, gamepad

        hand = Hand(clock, _interrupt, alone=alone)
        with gamepad(find_gamepad() if device == GAMEPAD else device, hand.put):
            yield hand
    else:
        yield Hand(clock, _interrupt, alone=alone, recorded=read_events(Path(device)))


def _interrupt() -> None:
    os.kill(os.getpid(), signal.SIGINT)
