"""The rover's wire: one UDP socket and the thread that listens to it. The only I/O on this side."""

from __future__ import annotations

import socket
import threading
from typing import TYPE_CHECKING

from adatracker_deploy import PlatformError, UsageError

from adatracker_rover.protocol.messages import Report, Request, decode_report, encode_request

if TYPE_CHECKING:
    from collections.abc import Callable

_LISTEN_S = 0.1
"""Longest wait of `close` for the listener."""


class Wire:
    """Open until `close`; calls `hear` in its own thread with every report.

    Raises:
        UsageError: the address cannot be one.
    """

    def __init__(self, host: str, port: int, hear: Callable[[Report], None]) -> None:
        self._hear = hear
        self._open = True
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.settimeout(_LISTEN_S)
        try:
            self._socket.connect((host, port))  # from now on it hears the rover alone
        except OSError as error:
            self._socket.close()
            raise UsageError(f"connection.host {host!r}: {error.strerror}; give its address") from error
        self._listener = threading.Thread(target=self._listen, name="rover", daemon=True)
        self._listener.start()

    def send(self, request: Request) -> None:
        """Send one datagram; that it arrives is not known.

        Raises:
            PlatformError: it could not even leave.
        """
        try:
            self._socket.send(encode_request(request))
        except OSError as error:
            raise PlatformError(f"the rover cannot be reached: {error.strerror}") from error

    def close(self) -> None:
        """Let go of the thread and of the socket."""
        self._open = False
        self._listener.join()
        self._socket.close()

    def _listen(self) -> None:
        while self._open:
            try:
                report = decode_report(self._socket.recv(64))
            except OSError:  # silence for a while, or nobody at that port yet
                continue
            if report is not None:
                self._hear(report)
