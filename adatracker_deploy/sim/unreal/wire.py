"""UnrealCV's protocol over a socket, as its plugin reads and writes it.

A message is a uint32 of magic, a uint32 of size, both little-endian, and so many bytes (`UnixTcpServer.cpp`).
The server greets with "connected to PROJECT"; a request is "ID:COMMAND", its reply "ID:" and a text or the
bytes of a picture, in order (`UnrealcvServer.cpp`). It serves one client at a time.

The `unrealcv` package's own client is not used: it requires `opencv-python`, which overwrites the files of
the toolkit's `opencv-python-headless`, and docker; it prints on stdout, which is for results here.
"""

from __future__ import annotations

import socket
import struct
from pathlib import Path
from typing import TYPE_CHECKING

from adatracker_deploy.core.errors import PlatformError, UsageError
from adatracker_deploy.sim.unreal.address import LOOPBACK

if TYPE_CHECKING:
    from collections.abc import Sequence

MAGIC = 0x9E2B83C1
HEADER = struct.Struct("<II")
LARGEST = 256 << 20
"""The plugin's own limit of a payload, bytes."""
GREETING = b"connected to "
AT_ONCE = 32
"""Requests on their way at once: as many as the plugin answers between two pictures of the game."""
_GREETING_S = 10.0
_ANSWER_S = 60.0
"""Machine time, s; opening a level takes long."""


class Client:
    """A connection; one thread uses it at a time."""

    def __init__(self, wire: socket.socket, name: str) -> None:
        """Take a socket whose server has greeted; `name` is for messages."""
        self._wire, self.name, self._next = wire, name, 0
        wire.settimeout(_ANSWER_S)

    def ask(self, commands: Sequence[str], *, lenient: bool = False) -> list[bytes]:
        """Send commands and return their replies, in order.

        Args:
            commands: without their numbers.
            lenient: whether a reply may be an error.

        Raises:
            PlatformError: the connection is lost, the server is silent, or it answers with an error.
        """
        replies: list[bytes] = []
        for begin in range(0, len(commands), AT_ONCE):
            some = commands[begin : begin + AT_ONCE]
            first, self._next = self._next, self._next + len(some)
            try:
                requests = (f"{first + at}:{command}".encode() for at, command in enumerate(some))
                self._wire.sendall(b"".join(map(framed, requests)))
                replies += [self._reply(first + at, command) for at, command in enumerate(some)]
            except TimeoutError as error:
                raise PlatformError(f"UnrealCV at {self.name} does not answer for {_ANSWER_S:g} s") from error
            except OSError as error:
                raise PlatformError(f"UnrealCV at {self.name}: the connection is lost ({error})") from error
        for command, reply in zip(commands, replies, strict=True):
            if reply.startswith(b"error") and not lenient:
                reason = reply[:200].decode(errors="replace")
                raise PlatformError(f"UnrealCV at {self.name} answers {command!r} with {reason!r}")
        return replies

    def close(self) -> None:
        """Close the connection."""
        self._wire.close()

    def _reply(self, number: int, command: str) -> bytes:
        head, colon, body = received(self._wire).partition(b":")
        if not colon or head != b"%d" % number:
            raise PlatformError(f"UnrealCV at {self.name}: an answer is of another request than {command!r}")
        return body


def connect(host: str, port: int) -> Client:
    """Connect to a server and wait for its greeting.

    On Linux a plugin serves TCP once; when that client has left it listens on a Unix socket only
    (`OnClientConnected` in `UnixTcpServer.cpp`). So that one is tried first, on this machine.

    Raises:
        UsageError: nobody answers there, or not with UnrealCV's greeting.
    """
    name = f"{host}:{port}"
    local = Path(f"/tmp/unrealcv_{port}.socket")
    for family in (socket.AF_UNIX, socket.AF_INET):
        if family is socket.AF_UNIX and not (host in LOOPBACK and local.is_socket()):
            continue
        wire: socket.socket | None = None
        try:
            if family is socket.AF_UNIX:
                wire = socket.socket(family, socket.SOCK_STREAM)
                wire.settimeout(_GREETING_S)
                wire.connect(str(local))
            else:
                wire = socket.create_connection((host, port), timeout=_GREETING_S)
                wire.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            wire.settimeout(_GREETING_S)
            if received(wire).startswith(GREETING):
                return Client(wire, name)
            reason = "the greeting is not UnrealCV's"
        except TimeoutError:
            reason = "no greeting; it serves one client at a time"
        except OSError as error:
            reason = str(error)
        if wire is not None:
            wire.close()
    raise UsageError(f"no UnrealCV server at {name}: {reason}; start the game first")


def framed(payload: bytes) -> bytes:
    """Return a payload as a message."""
    return HEADER.pack(MAGIC, len(payload)) + payload


def received(wire: socket.socket) -> bytes:
    """Return the next message's payload.

    Raises:
        OSError: the connection ended, or what comes is not this protocol.
    """
    magic, size = HEADER.unpack(_exactly(wire, HEADER.size))
    if magic != MAGIC or size > LARGEST:
        raise ConnectionError("what comes is not UnrealCV's protocol")
    return _exactly(wire, size)


def _exactly(wire: socket.socket, size: int) -> bytes:
    data = bytearray(size)
    view = memoryview(data)
    while view:
        got = wire.recv_into(view)
        if got == 0:
            raise ConnectionError("closed by the server")
        view = view[got:]
    return bytes(data)
