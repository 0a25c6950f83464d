"""The queue of one client of the live view: the newest messages, of bounded number and size."""

from __future__ import annotations

import threading
from collections import deque
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from adatracker_deploy.trial.channels import Message

BACKLOG = 128
"""Messages that may wait for one client: about a second at 20 Hz, of pictures of 640x480 some 1.5 MB."""
BACKLOG_BYTES = 16 << 20
"""Their size at most, bytes, where they are more than one. Clients share what waits for several of them."""


class Backlog:
    """A queue that loses its oldest; the thread that puts never waits for the one that takes."""

    def __init__(self) -> None:
        self._messages: deque[Message] = deque()
        self._bytes = 0
        self._lock = threading.Lock()  # held for some microseconds

    def put(self, message: Message) -> None:
        """Add the newest; the oldest that are too many go."""
        with self._lock:
            self._messages.append(message)
            self._bytes += len(message.data)
            while len(self._messages) > BACKLOG or (self._bytes > BACKLOG_BYTES and len(self._messages) > 1):
                self._bytes -= len(self._messages.popleft().data)

    def take(self) -> Message | None:
        """Return the oldest; None if there is none."""
        with self._lock:
            if not self._messages:
                return None
            message = self._messages.popleft()
            self._bytes -= len(message.data)
            return message
