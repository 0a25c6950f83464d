"""Incremental parser of the multipart streams that IP cameras send over HTTP; no I/O.

``multipart/x-mixed-replace`` with RFC 2046's syntax. Real cameras bend it: many announce the boundary with
the dashes that belong before it, some end lines with a bare line feed, some leave Content-Length out.
"""

from __future__ import annotations

import re
from typing import NamedTuple

LARGEST_HEADER_BYTES = 1 << 16
LARGEST_BODY_BYTES = 8 << 20
_END_OF_HEADER = re.compile(rb"\n\r?\n")
_LENGTH = re.compile(r"[0-9]{1,9}")


class Part(NamedTuple):
    """One part of the stream."""

    headers: dict[str, str]
    """By lower-case name."""
    body: bytes


class MultipartParser:
    """Gives the parts of a stream that arrives in pieces of any size.

    Args:
        boundary: as the response's Content-Type announces it.

    Raises:
        ValueError: a boundary of nothing but dashes.
    """

    def __init__(self, boundary: str) -> None:
        token = boundary.strip("-").encode("latin-1", "replace")
        if not token:
            raise ValueError("the stream names no boundary")
        self._delimiter = re.compile(rb"(?:\r?\n)?--(?:--)?" + re.escape(token))
        self._overlap = len(token) + 6
        """The longest delimiter: one that is not complete yet begins no earlier than this before the end."""
        self._buffer = bytearray()
        self._searched = 0
        """No delimiter begins before this place of the buffer, so that nothing is searched twice."""
        self._in_part = False
        self._headers: dict[str, str] | None = None

    def feed(self, data: bytes) -> list[Part]:
        """Take the stream's next bytes; return the parts that they complete, oldest first.

        Raises:
            ValueError: not a multipart stream, or a part exceeds the caps; the parser cannot continue.
        """
        self._buffer += data
        return list(iter(self._next_part, None))

    def _next_part(self) -> Part | None:
        """Take one part off the buffer; None while it is not complete."""
        if not self._in_part:
            if self._take_until_delimiter(LARGEST_HEADER_BYTES) is None:
                return None
            self._in_part = True
        if self._headers is None:
            self._headers = self._take_headers()
            if self._headers is None:
                return None
        body = self._take_body(self._headers)
        if body is None:
            return None
        part = Part(self._headers, body)
        self._headers = None
        self._in_part = "content-length" not in part.headers  # the next one's delimiter has ended it
        return part

    def _take_headers(self) -> dict[str, str] | None:
        end = _END_OF_HEADER.search(self._buffer)
        if (end.start() if end else len(self._buffer) - 2) > LARGEST_HEADER_BYTES:
            raise ValueError(f"a part's header is longer than {LARGEST_HEADER_BYTES} bytes")
        if end is None:
            return None
        lines = bytes(self._buffer[: end.start()]).decode("latin-1").split("\n")
        del self._buffer[: end.end()]
        pairs = (line.partition(":") for line in lines)
        return {name.strip().lower(): value.strip() for name, colon, value in pairs if colon}

    def _take_body(self, headers: dict[str, str]) -> bytes | None:
        length = headers.get("content-length")
        if length is None:
            return self._take_until_delimiter(LARGEST_BODY_BYTES)
        if not _LENGTH.fullmatch(length) or int(length) > LARGEST_BODY_BYTES:
            raise ValueError(f"a part's length is {length[:20]!r}, expected 0 to {LARGEST_BODY_BYTES} bytes")
        if len(self._buffer) < int(length):
            return None
        body = bytes(self._buffer[: int(length)])
        del self._buffer[: int(length)]
        return body

    def _take_until_delimiter(self, most: int) -> bytes | None:
        """Take the next delimiter and return what stood before it; None while none is complete."""
        found = self._delimiter.search(self._buffer, self._searched)
        if (found.start() if found else len(self._buffer) - self._overlap) > most:
            raise ValueError(f"no boundary came within {most} bytes")
        if found is None:
            self._searched = max(0, len(self._buffer) - self._overlap)
            return None
        before = bytes(self._buffer[: found.start()])
        del self._buffer[: found.end()]
        self._searched = 0
        return before
