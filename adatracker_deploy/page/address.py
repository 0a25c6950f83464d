"""Address of the operator's page: a port of this machine, and a token."""

from __future__ import annotations

import socket
from dataclasses import dataclass, field

from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.core.ports import unused_port
from adatracker_deploy.page.access import new_token

HOST = "127.0.0.1"
DEFAULT_PORT = 8766
"""Next to Foxglove's 8765."""


@dataclass(frozen=True, slots=True)
class Address:
    """A page's address, which all trials of one command share."""

    port: int
    token: str = field(default_factory=new_token, repr=False)

    @property
    def url(self) -> str:
        """The URL that the operator opens; browsers send the part behind # to nobody."""
        return f"http://{HOST}:{self.port}/#{self.token}"


def free_port(port: int, of: str, option: str) -> int:
    """Check that a port of this machine is free; return it, for 0 any that is.

    Args:
        port: the one that is wanted.
        of: what is to be served there, for the error.
        option: with which another is chosen, likewise.

    Raises:
        UsageError: it is not.
        PlatformError: 0, and there is none.
    """
    if port == 0:
        return unused_port(socket.SOCK_STREAM)
    with socket.socket() as asked:
        asked.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)  # as the server: what just ended is free
        try:
            asked.bind((HOST, port))
        except OSError as error:
            raise port_refused(port, str(error.strerror), of, option) from error
    return port


def port_refused(port: int, reason: str, of: str, option: str) -> UsageError:
    """Return the error that says so."""
    return UsageError(f"TCP port {port} for {of}: {reason}; choose another with {option} PORT")
