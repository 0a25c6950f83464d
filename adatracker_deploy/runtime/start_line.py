"""Start of several robots together: each run says how far it is, and waits until the others are as far.

A pair of connected sockets joins a run with the command of its fleet: a byte goes up when the run has reached
a stage, one comes down when all have. A run whose command is gone does not start.
"""

from __future__ import annotations

import contextlib
import socket
import time

CHECKED, READY = 1, 2
"""The stages: the whole request is right, nothing has been opened; the robot is connected, nothing moves."""
POLL_S = 0.02


class StartLine:
    """The run's end.

    Args:
        number: the file descriptor of a connected socket.

    Raises:
        OSError: it is none.
    """

    def __init__(self, number: int) -> None:
        self._socket = socket.socket(fileno=number)
        self._socket.setblocking(False)

    def reach(self) -> None:
        """Say that the next stage is reached."""
        with contextlib.suppress(OSError):  # a command that is gone is noticed by `open`
            self._socket.send(b"+")

    def open(self) -> bool:
        """Return whether all have reached this stage; never blocks.

        Raises:
            KeyboardInterrupt: the fleet's command has stopped, or is gone.
        """
        try:
            told = self._socket.recv(1)
        except BlockingIOError:
            return False
        except OSError:
            told = b""
        if not told:
            raise KeyboardInterrupt
        return True

    def wait(self) -> None:
        """Reach the next stage, and wait until all have.

        Raises:
            KeyboardInterrupt: the fleet's command has stopped, or is gone.
        """
        self.reach()
        while not self.open():
            time.sleep(POLL_S)


class StartLineKeeper:
    """The command's end, for one run; `theirs` goes to it."""

    def __init__(self) -> None:
        self._socket, self.theirs = socket.socketpair()
        self._socket.setblocking(False)
        self._reached = 0

    def reached(self) -> int:
        """Return how many stages the run has reached."""
        with contextlib.suppress(OSError):
            self._reached += len(self._socket.recv(16))
        return self._reached

    def release(self) -> None:
        """Let the run go on to the next stage."""
        with contextlib.suppress(OSError):  # it has ended
            self._socket.send(b"+")

    def close(self) -> None:
        """Let the run go no further; may be called twice."""
        self._socket.close()
