"""Subscriber: keeps the newest valid message on one key, with its reception time.

Each subscriber's thread waits on its own channel, so a message's age is right whether or not anybody reads
it. The thread ends when the session is closed.
"""

from __future__ import annotations

import threading
from typing import TYPE_CHECKING, Generic, TypeVar

import zenoh

from adatracker_deploy.core.stamps import Reading

if TYPE_CHECKING:
    from collections.abc import Callable

    from adatracker_deploy.core.clock import Clock

T = TypeVar("T")


class Subscriber(Generic[T]):
    """Subscribes to one key; of the messages that arrive during decoding only the newest is kept.

    Args:
        session: the subscriber ends with it.
        key: without wildcards.
        decode: returns the message in a payload, or raises ValueError: it is then dropped and counted.
        clock: the run's.
        cap_bytes: no longer payload is even copied.
    """

    def __init__(
        self,
        session: zenoh.Session,
        key: str,
        decode: Callable[[bytes], T],
        clock: Clock,
        cap_bytes: int,
    ) -> None:
        self._subscriber = session.declare_subscriber(key, zenoh.handlers.RingChannel(1))
        self._decode = decode
        self._clock = clock
        self._cap_bytes = cap_bytes
        self.newest: Reading[T] | None = None
        self.dropped = 0
        """Number of malformed messages."""
        self._thread = threading.Thread(target=self._run, name=f"subscriber {key}", daemon=True)
        self._thread.start()

    def join(self) -> None:
        """Wait for the thread's end; close the session first."""
        self._thread.join()

    def _run(self) -> None:
        while True:
            try:
                sample = self._subscriber.recv()
            except zenoh.ZError:  # the session is closed
                return
            t_ns = self._clock.now_ns()
            try:
                if len(sample.payload) > self._cap_bytes:
                    raise ValueError(f"{len(sample.payload)} bytes are more than {self._cap_bytes}")
                value = self._decode(bytes(sample.payload))
            except ValueError:
                self.dropped += 1
                continue
            self.newest = Reading(value, t_ns, self.newest.count + 1 if self.newest else 1)
