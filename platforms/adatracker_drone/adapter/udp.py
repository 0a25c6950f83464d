"""A MAVLink link over UDP owned by this side, so that it can filter senders and sign.

MAVSDK's own UDP accepts anything from anywhere, and signs nothing.
"""

from __future__ import annotations

import contextlib
import select
import socket
import threading
import time
from typing import TYPE_CHECKING

from adatracker_deploy.core.errors import UsageError
from adatracker_drone.adapter.sender_filter import Address, Guard

if TYPE_CHECKING:
    from collections.abc import Callable

    from adatracker_drone.protocol.signing import Signer

_LARGEST = 65535
_LOOK_S = 0.1
_QUEUE_BYTES = 1 << 20
_MOST_AT_ONCE = 64
_MOST_QUEUED = 4096
"""Datagrams that a queue is emptied of when the autopilot gets another."""
_STRANGERS_S = 0.02
"""Interval between reads of unknown senders' datagrams: their flood then costs a few per cent of a core."""


class UdpLink:
    """One link, to one autopilot.

    Once the autopilot is known it has its own connected socket, to which the kernel admits nobody else: a
    flood from others fills another queue, whose overflow the kernel drops uncounted.

    Args:
        address: to bind, or to dial.
        system: the autopilot's system id.
        signer: None where nothing is signed.
        hear: called in the link's thread with whole frames.
        binds: whether this side waits at `address` for the autopilot; otherwise it dials it.
        peer: the autopilot's address, where this side waits for one that it knows.

    Raises:
        UsageError: the address cannot be bound or dialled.
    """

    def __init__(
        self,
        address: Address,
        system: int,
        signer: Signer | None,
        hear: Callable[[bytes], None],
        *,
        binds: bool,
        peer: Address | None = None,
    ) -> None:
        self.guard = Guard(system, peer if binds else address, signer)
        self._signer = signer
        self._hear = hear
        self._unix_ns = time.time_ns() - time.monotonic_ns()
        """Offset to Unix time, fixed so that setting the clock cannot make signatures stale."""
        self._sending = threading.Lock()
        self._closed = False
        self._strangers_s = 0.0
        """Time of the next check of unknown senders."""
        self._sockets = [_bound(address) if binds else _dialling(address)]
        self._spoken_to = None if binds else self._sockets[0]
        if binds and peer is not None:
            self._pin(peer)
        self._thread = threading.Thread(target=self._listen, name="mavlink", daemon=True)

    def start(self) -> None:
        """Begin to listen."""
        self._thread.start()

    def send(self, frame: bytes) -> None:
        """Send one frame to the autopilot, from any thread; nothing is sent before the autopilot is known."""
        with self._sending:
            if self._spoken_to is None or self._closed:
                return
            if self._signer is not None:
                frame = self._signer.sign(frame, self._now_ns())
            with contextlib.suppress(OSError):  # a full or absent receiver loses it, as on any radio
                self._spoken_to.send(frame)

    def close(self) -> None:
        """End the thread and release the port; may be called twice."""
        with self._sending:
            self._closed = True
        if self._thread.ident is not None:
            self._thread.join()
        for each in self._sockets:
            each.close()

    def _listen(self) -> None:
        while not self._closed:
            if self._spoken_to is None:
                self._wait_and_read(self._sockets, _LOOK_S)
            else:
                self._wait_and_read([self._spoken_to], _STRANGERS_S)
                if time.monotonic() > self._strangers_s and len(self._sockets) > 1:
                    self._strangers_s = time.monotonic() + _STRANGERS_S
                    self._read(self._sockets[-1])

    def _wait_and_read(self, sockets: list[socket.socket], timeout_s: float) -> None:
        for ready in select.select(sockets, [], [], timeout_s)[0]:
            self._read(ready)

    def _read(self, ready: socket.socket, most: int = _MOST_AT_ONCE) -> None:
        with contextlib.suppress(OSError):  # nothing left to read, or nobody there yet
            for _ in range(most):
                datagram, sender = ready.recvfrom(_LARGEST)
                frames = self.guard.admit(datagram, sender, self._now_ns())
                if frames:
                    self._hear(frames)
                if self._spoken_to is None and self.guard.peer is not None:
                    self._pin(self.guard.peer)
                    return self._read(ready, _MOST_QUEUED)  # before what comes next: signed times only grow
        return None

    def _pin(self, peer: Address) -> None:
        (gate,) = self._sockets
        with self._sending:
            self._spoken_to = _beside(gate, peer)
        self._sockets.insert(0, self._spoken_to)

    def _now_ns(self) -> int:
        return self._unix_ns + time.monotonic_ns()


def _bound(address: Address) -> socket.socket:
    made = _socket()
    try:
        made.bind(address)
    except OSError as error:
        made.close()
        raise UsageError(
            f"UDP {address[0]}:{address[1]} cannot be used ({error.strerror}): stop the program that "
            "holds it (a ground station, another run), or give another connection.url"
        ) from error
    return made


def _dialling(address: Address) -> socket.socket:
    made = _socket()
    try:
        made.connect(address)
    except OSError as error:
        made.close()
        raise UsageError(
            f"UDP {address[0]}:{address[1]} cannot be reached ({error.strerror}): correct connection.url"
        ) from error
    return made


def _beside(gate: socket.socket, peer: Address) -> socket.socket:
    """Return a socket at the same port for one peer alone, and let nobody else do the same."""
    made = _socket()
    for each in (gate, made):
        each.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    made.bind(gate.getsockname())
    for each in (gate, made):
        each.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 0)
    made.connect(peer)
    return made


def _socket() -> socket.socket:
    made = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    made.setblocking(False)
    made.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _QUEUE_BYTES)
    return made
