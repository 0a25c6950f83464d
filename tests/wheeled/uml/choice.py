"""Chooses this machine's place with a real SocketCAN bus: its own kernel or user-mode Linux."""

from __future__ import annotations

from typing import TYPE_CHECKING

from tests.wheeled.uml import launcher, namespace

if TYPE_CHECKING:
    from tests.wheeled.uml.room import Room


class NoRoomError(Exception):
    """This machine has none; says why."""


def find_room() -> Room:
    """Return the machine's own kernel if it has vcan and lends it, else user-mode Linux.

    Raises:
        NoRoomError: neither is to be had.
    """
    trial = namespace.run(["true"], limit_s=20.0)
    if trial.status == 0:
        return namespace.run
    if launcher.kernel():
        return launcher.run
    raise NoRoomError(
        f"needs SocketCAN: this kernel lends none ({trial.output.strip() or trial.status}) "
        "and user-mode Linux is not installed (apt-get install user-mode-linux), or cannot run here"
    )
