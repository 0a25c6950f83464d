"""A small socketcand: a CAN bus over TCP, for the simulator.

It speaks what socketcand's clients use in raw mode (github.com/linux-can/socketcand, doc/protocol.md): every
frame that one sends is seen by all the others, as on a bus. Lines are parsed by `Parser`, which is pure.
"""

from __future__ import annotations

import contextlib
import selectors
import socket
import threading
import time
from typing import TYPE_CHECKING, Literal

from adatracker_wheeled.protocol.frames import CanFrame

if TYPE_CHECKING:
    from collections.abc import Callable

LONGEST_LINE = 200
"""Bytes; the longest that means anything has 60."""
MOST_CLIENTS = 8
MOST_UNSENT = 1 << 16
"""Bytes that a client may leave unread before it is dropped: a stopped one must not fill the memory."""

Request = CanFrame | Literal["open", "rawmode", "echo", "rehearsal"]


class Parser:
    """Parses a client's requests; malformed ones are dropped and counted."""

    def __init__(self) -> None:
        self.dropped = 0
        """Lines that meant nothing."""
        self._rest = b""

    def feed(self, data: bytes) -> list[Request]:
        """Return what the bytes up to here have completed."""
        requests: list[Request] = []
        *lines, rest = (self._rest + data).split(b">")
        for line in lines:
            request = _request(line)
            if request is None:
                self.dropped += 1
            else:
                requests.append(request)
        if len(rest) > LONGEST_LINE:
            self.dropped += 1
            rest = b""
        self._rest = rest
        return requests


def _request(line: bytes) -> Request | None:
    """Read one line without its closing bracket."""
    try:
        words = line.decode("ascii").split()
        if len(line) > LONGEST_LINE or words[0] != "<":
            return None
        if words[1] == "send":
            return _frame(words[2:])
        return next((known for known in ("open", "rawmode", "echo", "rehearsal") if words[1] == known), None)
    except (ValueError, IndexError):
        return None


def _frame(words: list[str]) -> CanFrame:
    """Read ``ID LENGTH BYTE...``, in hexadecimal; 8 digits mean a 29-bit id.

    Raises:
        ValueError: that is not a frame.
    """
    digits, length, *rest = words
    data = bytes(_hexadecimal(byte, 2) for byte in rest)
    if len(data) != _hexadecimal(length, 1):
        raise ValueError("as many bytes as the length says")
    return CanFrame(_hexadecimal(digits, 8), data, extended=len(digits) == 8)


def _hexadecimal(digits: str, most: int) -> int:
    if not digits.isalnum() or len(digits) > most:  # int() would also take signs and underscores
        raise ValueError("hexadecimal digits")
    return int(digits, 16)


def frame_line(frame: CanFrame, t_s: float) -> bytes:
    """Return the line that tells a client of a frame received at `t_s`, Unix time."""
    number = f"{frame.id:08X}" if frame.extended else f"{frame.id:03X}"
    return f"< frame {number} {t_s:.6f} {frame.data.hex().upper()} >".encode()


class _Client:
    def __init__(self, connection: socket.socket) -> None:
        self.socket = connection
        self.parser = Parser()
        self.raw = False
        self.unsent = b"< hi >"

    def flush(self) -> None:
        """Send what the connection takes now."""
        if self.unsent:
            with contextlib.suppress(BlockingIOError):
                self.unsent = self.unsent[self.socket.send(self.unsent) :]
        if len(self.unsent) > MOST_UNSENT:
            raise ConnectionError("it does not read")


class SocketcandServer:
    """Serves one bus on 127.0.0.1 in a thread of its own.

    Args:
        port: TCP port; 0 takes any free one.
        hear: called in the server's thread with each frame that a client sends.
        token: the answer to ``< rehearsal >``, so that a rehearsal knows its own simulator.

    Raises:
        OSError: the port is in use.
    """

    def __init__(self, port: int, hear: Callable[[CanFrame], None], token: str = "") -> None:
        self._hear = hear
        self._answers = {"echo": b"< echo >", "rehearsal": f"< rehearsal {token} >".encode()}
        self._listener = socket.create_server(("127.0.0.1", port))
        self._listener.setblocking(False)
        self.port: int = self._listener.getsockname()[1]
        self._clients: list[_Client] = []
        self._lock = threading.Lock()
        self._selector = selectors.DefaultSelector()
        self._selector.register(self._listener, selectors.EVENT_READ)
        self._closed = self._cut = False
        self._thread = threading.Thread(target=self._serve, name="socketcand", daemon=True)
        self._thread.start()

    def send(self, frame: CanFrame, sender: _Client | None = None) -> None:
        """Let every client but the sender see a frame; one that does not read is dropped."""
        line = frame_line(frame, time.time())
        with self._lock:
            for client in [client for client in self._clients if client.raw and client is not sender]:
                client.unsent += line
                self._flush(client)

    def cut(self, is_cut: bool) -> None:
        """Hang up on everybody and let nobody in, as a pulled plug does; or let them in again."""
        with self._lock:
            self._cut = is_cut
            for client in list(self._clients) if is_cut else ():
                self._drop(client)

    def close(self) -> None:
        """Hang up on everybody; may be called twice."""
        self._closed = True
        self._thread.join()
        with self._lock:
            for client in list(self._clients):
                self._drop(client)
            self._listener.close()
            self._selector.close()

    def _serve(self) -> None:
        while not self._closed:
            for key, _ in self._selector.select(0.1):
                if key.data is None:
                    self._accept()
                else:
                    self._read(key.data)

    def _accept(self) -> None:
        with contextlib.suppress(OSError), self._lock:
            connection, _ = self._listener.accept()
            if self._cut or len(self._clients) >= MOST_CLIENTS:
                connection.close()
                return
            connection.setblocking(False)
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            client = _Client(connection)
            self._clients.append(client)
            self._selector.register(connection, selectors.EVENT_READ, client)
            self._flush(client)

    def _read(self, client: _Client) -> None:
        try:
            data = client.socket.recv(65536)
        except BlockingIOError:
            return
        except OSError:
            data = b""
        if not data:
            with self._lock:
                self._drop(client)
            return
        for request in client.parser.feed(data):
            if isinstance(request, CanFrame):
                self._hear(request)
                self.send(request, client)
            else:
                client.raw = client.raw or request == "rawmode"
                with self._lock:
                    client.unsent += self._answers.get(request, b"< ok >")
                    self._flush(client)

    def _flush(self, client: _Client) -> None:
        try:
            client.flush()
        except OSError:
            self._drop(client)

    def _drop(self, client: _Client) -> None:
        if client in self._clients:
            self._clients.remove(client)
            self._selector.unregister(client.socket)
            client.socket.close()
