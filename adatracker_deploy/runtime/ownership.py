"""Ensures that only one process on this machine drives a given robot.

A claim is an abstract Unix socket (unix(7)): the kernel gives its name to one process at a time and frees it
however that process ends. It works across users and needs no file. Like a CAN interface it belongs to a
network namespace, so containers with their own networks do not see each other's claims.
"""

from __future__ import annotations

import contextlib
import errno
import socket
import struct
import sys

from adatracker_deploy.core.errors import PlatformError

_CREDENTIALS = struct.Struct("3i")
"""``struct ucred``: process, user and group id (unix(7), SO_PEERCRED)."""


class Claim:
    """This process's ownership of a robot, until `close` or until the process ends.

    Args:
        robot: names the robot's connection, the same in every run that would reach it:
            ``can:socketcan:can0``.

    Raises:
        PlatformError: another process on this machine owns it.
    """

    def __init__(self, robot: str) -> None:
        self._socket: socket.socket | None = None
        if not sys.platform.startswith("linux"):
            return
        address = f"\0adatracker-deploy/{robot}"
        made = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        try:
            made.bind(address)
            made.listen()
        except OSError as error:
            made.close()
            if error.errno != errno.EADDRINUSE:
                raise PlatformError(f"{robot} cannot be claimed: {error.strerror}") from error
            raise PlatformError(
                f"{robot} is driven by another program on this machine{_owner(address)}: end that one first"
            ) from error
        self._socket = made

    def close(self) -> None:
        """Release the robot; may be called twice."""
        made, self._socket = self._socket, None
        if made is not None:
            made.close()


def _owner(address: str) -> str:
    """Describe the process that holds a claim; empty if unknown."""
    with contextlib.suppress(OSError), socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as probe:
        probe.setblocking(False)
        probe.connect(address)
        credentials = probe.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, _CREDENTIALS.size)
        return f" (process {_CREDENTIALS.unpack(credentials)[0]})"
    return ""
