"""Decodes sensor_msgs/CompressedImage, the message of ROS 2 cameras, from CDR. Pure.

CDR (OMG DDSI-RTPS 10.2, plain version 1): a header of four bytes that states the byte order, then the fields,
each at a multiple of its size behind that header; a string is its length with a closing zero, then its bytes.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass

IMAGE_CAP_BYTES = 8 << 20
"""Largest message that is decoded, bytes; a 1080p JPEG has about 0.5 MiB, its raw pixels 6 MiB."""
_ORDERS = {b"\x00\x00": ">", b"\x00\x01": "<"}
_HEAD_BYTES = 4
_MOST_PADDING = 3
"""Zeros that a sender may put behind the message, to end at a multiple of four."""


@dataclass(frozen=True, slots=True)
class CompressedImage:
    """sensor_msgs/CompressedImage: an encoded image, not yet decoded."""

    stamp_ns: int
    """Since 1970, by the robot's clock."""
    format: str
    """``jpeg``, ``png`` or, by image_transport, such as ``rgb8; jpeg compressed bgr8``."""
    data: bytes | memoryview
    """The encoded image; decoded from a payload it is a view of it, and never empty."""
    frame_id: str = "camera"


def read_compressed_image(payload: bytes) -> CompressedImage:
    """Return the image in a message of at most `IMAGE_CAP_BYTES`, in either byte order.

    Lengths that exceed the payload are refused.

    Raises:
        ValueError: it is not such a message, is truncated or too long, or its image is empty.
    """
    if len(payload) > IMAGE_CAP_BYTES:
        raise ValueError(f"{len(payload)} bytes are more than {IMAGE_CAP_BYTES}")
    order = _ORDERS.get(payload[:2])
    if order is None:
        raise ValueError("not a message in plain CDR")
    try:
        reader = _Reader(memoryview(payload)[_HEAD_BYTES:], order)
        sec, nanosec = reader.number("i"), reader.number("I")
        frame_id, form = reader.text(), reader.text()
        data = reader.bytes(reader.number("I"))
    except struct.error as error:
        raise ValueError("an image message that ends too soon") from error
    if reader.left > _MOST_PADDING:
        raise ValueError(f"an image message with {reader.left} bytes behind it")
    if sec < 0 or nanosec >= 10**9:
        raise ValueError(f"no time has {sec} s and {nanosec} ns")
    if not data:
        raise ValueError("an image without data")
    return CompressedImage(sec * 10**9 + nanosec, form, data, frame_id)


class _Reader:
    """Reads CDR fields in order."""

    def __init__(self, body: memoryview, order: str) -> None:
        self._body = body
        self._order = order
        self._at = 0

    @property
    def left(self) -> int:
        return len(self._body) - self._at

    def number(self, kind: str) -> int:
        """Take a number of four bytes, of a kind as `struct` names it."""
        self._at += -self._at % 4
        (value,) = struct.unpack_from(self._order + kind, self._body, self._at)
        self._at += 4
        return int(value)

    def bytes(self, count: int) -> memoryview:
        if count > self.left:
            raise struct.error
        taken = self._body[self._at : self._at + count]
        self._at += count
        return taken

    def text(self) -> str:
        text = bytes(self.bytes(self.number("I")))
        if not text.endswith(b"\0"):
            raise ValueError("a text without its end")
        return text[:-1].decode()
