"""The keys of a terminal, in the layout of ROS 2's teleop_twist_keyboard.

A terminal tells no release of a key. A drive key is its own dead-man button: it counts as held while the
terminal repeats it, and for `KEY_HOLD_S` after.
"""

from __future__ import annotations

import contextlib
import os
import re
import termios
import tty
from typing import TYPE_CHECKING

from adatracker_deploy.runtime.teleop.device import Told, reading
from adatracker_deploy.runtime.teleop.takeover import AXES

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

KEY_HOLD_S = 0.15
"""How long a key counts as held, s. Desktops repeat every 30 to 40 ms, the Linux console every 92 ms (10.9 a
second, kbdrate(8)). With one slot of the link the robot is sent zero within 0.2 s of the last repetition."""
SHARE = 0.5
"""A key's share of the limits; `--speed-cap` scales it further."""
KEYS: dict[str, tuple[int, int, int, int]] = {
    "u": (1, 0, 0, 1), "i": (1, 0, 0, 0), "o": (1, 0, 0, -1),
    "j": (0, 0, 0, 1), "l": (0, 0, 0, -1),
    "m": (-1, 0, 0, -1), ",": (-1, 0, 0, 0), ".": (-1, 0, 0, 1),
    "J": (0, 1, 0, 0), "L": (0, -1, 0, 0),
    "t": (0, 0, 1, 0), "b": (0, 0, -1, 0),
}  # fmt: skip
"""Forward, left, up and counter-clockwise of each drive key."""
GIVE_BACK = "g"
_KEY = re.compile(r"\x1b(?:\[[0-9;]*[ -/]*[@-~]|O.)|.", re.DOTALL)
"""A key as a terminal tells it: a character, or an escape sequence (ECMA-48 5.4, and SS3)."""
_ENTER = ("\r", "\n")


def decode(data: bytes) -> Told:
    """Return what keys say: drive, give back, stop (Enter); any other takes over and stands still."""
    told: Told = []
    for key in _KEY.findall(data.decode(errors="replace")):
        if key in KEYS:
            told += [(axis, SHARE * way) for axis, way in zip(AXES, KEYS[key], strict=True)]
            told.append(("dead_man_s", KEY_HOLD_S))
        elif key == GIVE_BACK:
            told += [("dead_man", 0.0), ("give_back", 1.0)]
        elif key in _ENTER:
            told.append(("stop", 1.0))
        else:
            told.append(("take", 1.0))
    return told


@contextlib.contextmanager
def keyboard(terminal: int, put: Callable[..., None]) -> Iterator[None]:
    """Read a terminal's keys one by one until the context ends, then leave the terminal as it was.

    Args:
        terminal: its file descriptor.
        put: takes the events (`Hand.put`).
    """

    def read() -> Told:
        data = os.read(terminal, 4096)
        if not data:
            raise EOFError
        return decode(data)

    before = termios.tcgetattr(terminal)
    tty.setcbreak(terminal)  # Ctrl-C still interrupts
    try:
        with reading(terminal, read, put):
            yield
    finally:
        with contextlib.suppress(termios.error):  # its terminal may be gone
            termios.tcsetattr(terminal, termios.TCSADRAIN, before)
