"""One client of the live view: its socket, which is never waited for, and what is on its way there and back.

The library `websockets` speaks HTTP and websocket (its "Sans-I/O" layer); reading and writing are done here,
so that one thread serves all clients and each has bounds. All of it belongs to that thread but `offer`.
"""

from __future__ import annotations

import logging
import socket
import time
from collections import deque
from http import HTTPStatus
from typing import TYPE_CHECKING

from websockets.frames import CloseCode, Frame, Opcode
from websockets.http11 import Request
from websockets.protocol import State
from websockets.server import ServerProtocol
from websockets.typing import Subprotocol

from adatracker_deploy.trial.live_access import why_refused
from adatracker_deploy.trial.live_backlog import Backlog
from adatracker_deploy.trial.live_protocol import SUBPROTOCOLS, Subscriptions, message_frame

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from adatracker_deploy.trial.channels import Message

PATIENCE_S = 5.0
"""Time-out of a client's opening and closing handshake."""
LARGEST_REQUEST_BYTES = 64 << 10
_RECEIVE_BYTES = 16 << 10
_SEND_BUFFER_BYTES = 256 << 10
"""Size of the kernel's send buffer for a client; what it holds can no longer be dropped, however old."""
_ANSWERS = 64
"""Answers that may wait for a client before no more is read from it."""
_QUIET = logging.getLogger("adatracker_deploy.live_view")
_QUIET.setLevel(logging.CRITICAL + 1)  # stderr is the tracker's


class Client:
    """Tells one connection what it subscribes to.

    Args:
        connection: its socket, which is closed with it.
        welcome: texts that each client is sent first.
        topics: what can be told, by the channels' numbers.
    """

    def __init__(self, connection: socket.socket, welcome: Sequence[str], topics: Mapping[int, str]) -> None:
        connection.setblocking(False)
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _SEND_BUFFER_BYTES)
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self.connection = connection
        self.ended = False
        self.deadline_s: float | None = time.monotonic() + PATIENCE_S
        """Time-out of the connection, on the monotonic clock; None if it may stay."""
        self._welcome = welcome
        self._subscriptions = Subscriptions(topics)
        self._backlog = Backlog()
        self._protocol = ServerProtocol(
            subprotocols=[Subprotocol(name) for name in SUBPROTOCOLS],
            max_size=LARGEST_REQUEST_BYTES,
            logger=_QUIET,
        )
        self._request = bytearray()
        self._request_is_text = False
        self._out: deque[memoryview] = deque()
        self._leaving = False
        self._last_words = False

    @property
    def wants_to_read(self) -> bool:
        """Whether what it sends is to be read now: not while it does not read the answers."""
        return len(self._out) < _ANSWERS

    @property
    def wants_to_write(self) -> bool:
        """Whether something waits until the socket takes it."""
        return bool(self._out)

    def offer(self, message: Message) -> bool:
        """Let a message wait for it, if it is subscribed; return whether. Any thread may call this."""
        if self._subscriptions.number(message.topic) is None:
            return False
        self._backlog.put(message)
        return True

    def read(self) -> None:
        """Take what it has sent, once."""
        try:
            data = self.connection.recv(_RECEIVE_BYTES)
        except BlockingIOError:
            return
        except OSError:
            data = b""
        if not data:
            self.ended = True
            return
        try:
            self._take(data)
        except Exception:  # of the library, 13.0: a header that is no UTF-8. What one sends ends itself alone
            self.ended = True

    def write(self) -> None:
        """Send what waits for it, as much as the socket takes."""
        try:
            while self._out or self._refill():
                sent = self.connection.send(self._out[0])
                if sent < len(self._out[0]):
                    self._out[0] = self._out[0][sent:]
                else:
                    self._out.popleft()
        except BlockingIOError:
            return
        except OSError:
            self.ended = True
        self.ended |= self._last_words

    def leave(self) -> None:
        """Send what waits, take leave, and end when it has done so too."""
        self._leaving = True
        self.ended |= self._protocol.state is not State.OPEN and not self._out

    def close(self) -> None:
        """Release the socket."""
        self.connection.close()

    def _take(self, data: bytes) -> None:
        self._protocol.receive_data(data)
        self._collect()
        for event in self._protocol.events_received():
            if isinstance(event, Request):
                self._open(event)
            elif isinstance(event, Frame):
                self._hear(event)
        self._collect()

    def _open(self, request: Request) -> None:
        protocol = self._protocol
        if self._last_words:
            return  # what it sent right behind its request has ended it already
        refusal = why_refused(request.headers.get_all("Host"), request.headers.get_all("Origin"))
        protocol.send_response(
            protocol.accept(request)
            if refusal is None
            else protocol.reject(HTTPStatus.FORBIDDEN, f"{refusal}\n")
        )
        if protocol.state is State.OPEN:
            self.deadline_s = None
            for text in self._welcome:
                protocol.send_text(text.encode())

    def _hear(self, frame: Frame) -> None:
        if frame.opcode in {Opcode.TEXT, Opcode.BINARY}:
            self._request_is_text = frame.opcode is Opcode.TEXT
        elif frame.opcode is not Opcode.CONT:
            return  # the library answers pings and leave
        self._request += frame.data
        if not frame.fin:
            return
        request, self._request = bytes(self._request), bytearray()
        for text in self._subscriptions.answer(request, is_text=self._request_is_text):
            if self._protocol.state is State.OPEN:
                self._protocol.send_text(text.encode())

    def _refill(self) -> bool:
        """Get the next message ready, or the leave; return whether there was anything."""
        if self._protocol.state is not State.OPEN:
            return False
        while (message := self._backlog.take()) is not None:
            number = self._subscriptions.number(message.topic)
            if number is not None:  # it may have changed its mind
                self._protocol.send_binary(message_frame(number, message.wall_ns, message.data))
                return self._collect()
        if self._leaving:
            self._protocol.send_close(CloseCode.GOING_AWAY)
            return self._collect()
        return False

    def _collect(self) -> bool:
        """Take from the library what is to be sent; return whether there was anything."""
        for data in self._protocol.data_to_send():
            if data:
                self._out.append(memoryview(data))
            else:  # its sign that nothing will follow
                self._last_words = True
                self.deadline_s = time.monotonic() + PATIENCE_S
        return bool(self._out)
