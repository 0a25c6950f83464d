"""Compressed images to pixels; no image is decoded before its size is known. Pure."""

from __future__ import annotations

from typing import TYPE_CHECKING

import cv2
import numpy as np

from adatracker_quadruped.protocol import Malformed

if TYPE_CHECKING:
    from numpy.typing import NDArray

MOST_PIXELS = 3840 * 2160
"""A few bytes of PNG can claim gigabytes of pixels; no robot's camera sends more than 4K."""
_PNG = b"\x89PNG\r\n\x1a\n"
_JPEG = b"\xff\xd8"
_FRAME_HEADERS = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}
"""JPEG's SOF markers (ITU-T T.81, table B.1): all of C0 to CF but the tables DHT, JPG and DAC."""
_NO_LENGTH = frozenset({0x01, *range(0xD0, 0xD8)})
"""TEM and RST0 to RST7 stand alone."""


def decode_rgb(data: bytes | memoryview) -> NDArray[np.uint8]:
    """Return a JPEG or PNG image as RGB, uint8 of shape (H, W, 3).

    Raises:
        Malformed: it is neither, it is larger than `MOST_PIXELS`, or it cannot be decoded.
    """
    view = memoryview(data)
    width, height = size_of(view)
    if not 0 < width * height <= MOST_PIXELS:
        raise Malformed(f"an image of {width} x {height} pixels")
    try:
        rgb = cv2.imdecode(np.frombuffer(view, np.uint8), cv2.IMREAD_COLOR_RGB)
    except cv2.error as error:
        raise Malformed(f"an image that cannot be decoded: {error}") from error
    if rgb is None:
        raise Malformed("an image that cannot be decoded")
    return np.asarray(rgb, np.uint8)


def size_of(data: memoryview) -> tuple[int, int]:
    """Return the width and height that a JPEG's or PNG's header states, px.

    Raises:
        Malformed: there is no such header.
    """
    if len(data) >= 24 and bytes(data[:8]) == _PNG and bytes(data[12:16]) == b"IHDR":
        return int.from_bytes(data[16:20], "big"), int.from_bytes(data[20:24], "big")
    if bytes(data[:2]) == _JPEG:
        return _jpeg_size(data)
    raise Malformed("an image that is neither JPEG nor PNG")


def _jpeg_size(data: memoryview) -> tuple[int, int]:
    at = len(_JPEG)
    while at + 9 <= len(data) and data[at] == 0xFF:
        marker = data[at + 1]
        if marker in _FRAME_HEADERS:
            height, width = data[at + 5 : at + 7], data[at + 7 : at + 9]
            return int.from_bytes(width, "big"), int.from_bytes(height, "big")
        if marker == 0xFF:  # a fill byte
            at += 1
        elif marker in _NO_LENGTH:
            at += 2
        else:
            at += 2 + int.from_bytes(data[at + 2 : at + 4], "big")
    raise Malformed("a JPEG without a frame header")
