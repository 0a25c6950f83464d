"""The live view: publishes the log's channels on a local websocket, for Foxglove and similar viewers.

It is read-only: it offers no capability to publish, set or call, and `live_access` decides whose pages may
watch. A client that reads too slowly loses the oldest of `BACKLOG` waiting messages; neither the log nor
another client ever waits for it. One thread serves all clients, in the log writer's process, far from the
control loop.
"""

from __future__ import annotations

import contextlib
import os
import selectors
import socket
import threading
import time
from typing import TYPE_CHECKING

from adatracker_deploy.page.address import HOST
from adatracker_deploy.trial.channels import channels
from adatracker_deploy.trial.live_port import port_refused
from adatracker_deploy.trial.live_protocol import advertise, server_info

if TYPE_CHECKING:
    from collections.abc import Iterable

    from adatracker_deploy.trial.channels import Message
    from adatracker_deploy.trial.live_client import Client

MAX_CLIENTS = 16
"""Connections at one time; one more is closed at once."""
STOP_TIMEOUT_S = 0.5
"""Time for clients to take their queued messages, and to leave, at the end."""


class LiveView:
    """Serves messages as they come, on loopback alone.

    Args:
        port: a free one.

    Raises:
        UsageError: it is in use.
    """

    def __init__(self, port: int) -> None:
        from adatracker_deploy.trial.live_client import Client  # it needs the extra

        self._client_type = Client
        offered = dict(enumerate(channels(), start=1))
        self._topics = {number: channel.topic for number, channel in offered.items()}
        self._welcome = (server_info("adatracker-deploy", str(time.time_ns())), advertise(offered))
        try:
            self._listener = socket.create_server((HOST, port))
        except OSError as error:
            raise port_refused(port, os.strerror(error.errno or 0)) from error
        self._listener.setblocking(False)
        self._bell, self._ringer = socket.socketpair()
        self._bell.setblocking(False)
        self._ringer.setblocking(False)
        self._selector = selectors.DefaultSelector()
        self._selector.register(self._listener, selectors.EVENT_READ)
        self._selector.register(self._bell, selectors.EVENT_READ)
        self._clients: tuple[Client, ...] = ()  # replaced, never changed: two threads look at it
        self._stop_s: float | None = None
        self._failure: Exception | None = None
        self._thread = threading.Thread(target=self._run, name="live view", daemon=True)
        self._thread.start()

    def show(self, messages: Iterable[Message]) -> None:
        """Send messages to whoever is subscribed to their topics; some microseconds each, read or not.

        Raises:
            RuntimeError: the view has failed.
        """
        if self._failure is not None:
            raise RuntimeError(f"{type(self._failure).__name__}: {self._failure}") from self._failure
        clients = self._clients
        wanted = [client.offer(message) for message in messages for client in clients]
        if any(wanted):
            self._ring()

    def close(self) -> None:
        """Take leave of the clients, for `STOP_TIMEOUT_S` at most; the process's end frees what is left."""
        self._stop_s = time.monotonic() + STOP_TIMEOUT_S
        self._ring()
        self._thread.join(STOP_TIMEOUT_S)

    def _ring(self) -> None:
        with contextlib.suppress(OSError):  # full: it has been rung; closed: nobody is there any more
            self._ringer.send(b"!")

    def _run(self) -> None:
        try:
            while self._stop_s is None:
                self._turn()
            self._selector.unregister(self._listener)
            self._listener.close()
            for client in self._clients:
                client.leave()
            self._write_and_drop()
            while self._clients and time.monotonic() < self._stop_s:
                self._turn()
        except Exception as error:  # show() says so
            self._failure = error
        finally:
            clients, self._clients = self._clients, ()
            for client in clients:
                client.close()
            for held in (self._listener, self._bell, self._ringer):
                held.close()
            self._selector.close()

    def _turn(self) -> None:
        """Wait until something can be done, and do it."""
        for key, events in self._selector.select(self._wait_s()):
            if key.fileobj is self._listener:
                self._accept()
            elif key.fileobj is self._bell:
                with contextlib.suppress(BlockingIOError):
                    self._bell.recv(4096)
            elif events & selectors.EVENT_READ:
                client: Client = key.data
                client.read()
        self._write_and_drop()

    def _wait_s(self) -> float | None:
        """Return how long nothing need be done, s; None for ever."""
        deadlines_s = [client.deadline_s for client in self._clients] + [self._stop_s]
        due_s = min((deadline_s for deadline_s in deadlines_s if deadline_s is not None), default=None)
        return None if due_s is None else max(0.0, due_s - time.monotonic())

    def _accept(self) -> None:
        try:
            connection, _ = self._listener.accept()
        except (BlockingIOError, ConnectionAbortedError):
            return
        if len(self._clients) >= MAX_CLIENTS:
            connection.close()
            return
        client = self._client_type(connection, self._welcome, self._topics)
        self._selector.register(connection, selectors.EVENT_READ, client)
        self._clients = (*self._clients, client)

    def _write_and_drop(self) -> None:
        """Send what can be sent; let go of clients that have ended or that take too long."""
        now_s = time.monotonic()
        for client in self._clients:
            client.write()
            if client.ended or (client.deadline_s is not None and client.deadline_s <= now_s):
                self._clients = tuple(other for other in self._clients if other is not client)
                self._selector.unregister(client.connection)
                client.close()
                continue
            wanted = (
                client.wants_to_read * selectors.EVENT_READ | client.wants_to_write * selectors.EVENT_WRITE
            )
            if wanted != self._selector.get_key(client.connection).events:
                self._selector.modify(client.connection, wanted, client)
