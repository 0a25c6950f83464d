"""Feed of the operator's page: the newest state with its picture, and events; nothing waits for a browser.

A browser gets a stream of updates. Each is three lengths (unsigned, 32 bits, little-endian) and then as many
bytes: a JSON object, the camera's JPEG, the class mask as PNG; a picture may be absent. A browser that reads
too slowly skips states and pictures; of events it loses the oldest.
"""

from __future__ import annotations

import json
import math
import struct
import threading
from collections import deque
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

HEADER = struct.Struct("<III")
KEPT_EVENTS = 40
"""The newest, for a browser that comes late."""
HEARTBEAT_S = 1.0
"""An empty update comes at least as often: so the page knows a dead server from a still one."""


class Pictures(NamedTuple):
    """One frame as a browser takes it; empty where it is not shown."""

    jpeg: bytes
    mask_png: bytes


class _Event(NamedTuple):
    number: int
    level: str
    text: str


class Feed:
    """Holds the newest of everything; any thread may use it.

    Args:
        about: what does not change: sent first, to each browser.
    """

    def __init__(self, about: Mapping[str, Any]) -> None:
        self._about = {"about": dict(about)}
        self._changed = threading.Condition()
        self._state: Mapping[str, Any] | None = None
        self._pictures = Pictures(b"", b"")
        self._shown, self._pictured, self._happened = 0, 0, 0
        """Numbers of renewals of each."""
        self._events: deque[_Event] = deque(maxlen=KEPT_EVENTS)
        self._browsers = 0
        self._ended = False

    @property
    def watched(self) -> bool:
        """Whether anybody looks, and pictures are worth encoding."""
        return self._browsers > 0

    def show(self, state: Mapping[str, Any], pictures: Pictures | None = None) -> None:
        """Replace the state, and the picture where there is a new one."""
        with self._changed:
            self._state, self._shown = state, self._shown + 1
            if pictures is not None:
                self._pictures, self._pictured = pictures, self._pictured + 1
            self._changed.notify_all()

    def say(self, level: str, text: str) -> None:
        """Add an event: info, warning or error."""
        with self._changed:
            self._happened += 1
            self._events.append(_Event(self._happened, level, text))
            self._changed.notify_all()

    def end(self) -> None:
        """End every stream."""
        with self._changed:
            self._ended = True
            self._changed.notify_all()

    def updates(self) -> Iterator[bytes]:
        """Yield one browser's updates, as they come, until the end."""
        with self._changed:
            self._browsers += 1
        try:
            yield _packed(self._about)
            shown = pictured = happened = 0
            while True:
                with self._changed:
                    self._changed.wait_for(partial(self._is_newer, shown, happened), HEARTBEAT_S)
                    if self._ended:
                        return
                    news: dict[str, Any] = {}
                    if self._shown != shown:
                        news["state"] = self._state
                    if self._happened != happened:
                        news["events"] = [event[1:] for event in self._events if event.number > happened]
                    pictures = self._pictures if self._pictured != pictured else None
                    shown, pictured, happened = self._shown, self._pictured, self._happened
                yield _packed(news, pictures)
        finally:
            with self._changed:
                self._browsers -= 1

    def _is_newer(self, shown: int, happened: int) -> bool:
        return self._ended or (self._shown, self._happened) != (shown, happened)


def _packed(news: Mapping[str, Any], pictures: Pictures | None = None) -> bytes:
    text = json.dumps(_plain(news), allow_nan=False).encode()
    jpeg, mask = pictures or (b"", b"")
    return HEADER.pack(len(text), len(jpeg), len(mask)) + text + jpeg + mask


def _plain(value: Any) -> Any:
    """Return a value as JSON can hold it: null for a number that is not finite."""
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    return [_plain(item) for item in value] if isinstance(value, list | tuple) else value
