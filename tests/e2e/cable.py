"""A cable for wires that are TCP: it carries bytes both ways until somebody pulls it or freezes it."""

from __future__ import annotations

import contextlib
import select
import socket
import threading


class Cable:
    """Listens on a free loopback port and forwards every connection to `target`.

    `cut` closes everything and lets nobody in, as a pulled plug or a dead router does; `freeze` keeps the
    connections open and carries nothing, as a frozen peer does; `mend` makes it whole again.
    """

    def __init__(self, target: tuple[str, int]) -> None:
        self._target = target
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.port = self._listener.getsockname()[1]
        self._pairs: list[tuple[socket.socket, socket.socket]] = []
        self._lock = threading.Lock()
        self._whole = threading.Event()
        self._whole.set()
        self._cut = self._ended = False
        self._wake_read, self._wake_write = socket.socketpair()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def cut(self) -> None:
        with self._lock:
            self._cut = True
            self._hang_up()
        self._wake()

    def freeze(self) -> None:
        self._whole.clear()
        self._wake()

    def mend(self) -> None:
        with self._lock:
            self._cut = False
        self._whole.set()
        self._wake()

    def close(self) -> None:
        self._ended = True
        self._whole.set()
        self._wake()
        self._thread.join()
        with self._lock:
            self._hang_up()
        for end in (self._listener, self._wake_read, self._wake_write):
            end.close()

    def _wake(self) -> None:
        with contextlib.suppress(OSError):
            self._wake_write.send(b"!")

    def _hang_up(self) -> None:
        for pair in self._pairs:
            for end in pair:
                end.close()
        self._pairs.clear()

    def _run(self) -> None:
        while not self._ended:
            self._whole.wait()
            with self._lock:
                ways = {here: there for pair in self._pairs for here, there in (pair, pair[::-1])}
            with contextlib.suppress(OSError, ValueError):  # an end was closed meanwhile
                ready, _, _ = select.select([self._listener, self._wake_read, *ways], [], [])
                for end in ready:
                    if end is self._wake_read:
                        end.recv(4096)
                    elif end is self._listener:
                        self._accept()
                    elif self._whole.is_set():
                        self._carry(end, ways[end])

    def _accept(self) -> None:
        near, _ = self._listener.accept()
        with self._lock:
            if self._cut:
                near.close()
                return
            try:
                far = socket.create_connection(self._target, timeout=2.0)
            except OSError:
                near.close()
                return
            for end in (near, far):
                end.settimeout(2.0)
                end.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            self._pairs.append((near, far))

    def _carry(self, here: socket.socket, there: socket.socket) -> None:
        try:
            data = here.recv(65536)
            if data:
                there.sendall(data)
                return
        except OSError:
            pass
        with self._lock:
            for pair in [pair for pair in self._pairs if here in pair]:
                self._pairs.remove(pair)
                for end in pair:
                    end.close()
