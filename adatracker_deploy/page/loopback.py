"""A small HTTP server for browsers of this machine: threads of a bounded number, which end with it."""

from __future__ import annotations

import contextlib
import socket
import sys
import threading
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Callable

MAX_CONNECTIONS = 16
"""At one time."""
_ROOM_TIMEOUT_S = 1.0
"""One more waits so long for room, then is closed. A client that has left takes room until the next pictures
are sent to it."""


class LoopbackServer(ThreadingHTTPServer):
    """Serves on 127.0.0.1 alone.

    Args:
        port: 0 takes any free one.
        handler: makes a handler of each connection.

    Raises:
        OSError: the port is in use.
    """

    daemon_threads = True
    allow_reuse_address = True

    def __init__(self, port: int, handler: Callable[..., BaseHTTPRequestHandler]) -> None:
        self._connections: set[socket.socket] = set()
        self._room = threading.Condition()
        super().__init__(("127.0.0.1", port), handler)

    def process_request(self, request: Any, client_address: Any) -> None:
        """Serve a connection in a thread of its own, or close it, if too many stay."""
        with self._room:
            room = self._room.wait_for(lambda: len(self._connections) < MAX_CONNECTIONS, _ROOM_TIMEOUT_S)
            if room:
                self._connections.add(request)
        if room:
            super().process_request(request, client_address)
        else:
            self.shutdown_request(request)

    def shutdown_request(self, request: Any) -> None:
        """Forget a connection that is served."""
        with self._room:
            self._connections.discard(request)
            self._room.notify()
        super().shutdown_request(request)

    def disconnect_all(self) -> None:
        """End every connection, whatever is being sent."""
        with self._room:
            for connection in self._connections:
                with contextlib.suppress(OSError):  # one that has left by itself must not keep the others
                    connection.shutdown(socket.SHUT_RDWR)

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Ignore a client that disconnects in the middle of an answer."""
        if not isinstance(sys.exception(), OSError):
            super().handle_error(request, client_address)
