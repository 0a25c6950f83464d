"""Decodes untrusted PNG and JPEG images; the size is checked before decoding. Pure."""

from __future__ import annotations

import struct
import zlib

import cv2
import numpy as np
from numpy.typing import NDArray

from adatracker_deploy.core.camera import check_size
from adatracker_deploy.perception.jpeg import decode_jpeg

PNG_START = b"\x89PNG\r\n\x1a\n"
_CHUNK = struct.Struct(">I4s")
"""A chunk's length and type; its CRC-32 over type and content follows the content (the same, 5.3)."""
_CRC_BYTES = 4
_HEADER = struct.Struct(">4x4sII")
"""The first chunk's length, its type, the width and the height (PNG specification, 11.2.2)."""


def png_size(data: bytes) -> tuple[int, int]:
    """Return width and height, px, as the header chunk states them.

    Raises:
        ValueError: this is not a PNG.
    """
    if not data.startswith(PNG_START):
        raise ValueError("not a PNG")
    if len(data) < len(PNG_START) + _HEADER.size:
        raise ValueError("not a PNG: it ends in its header")
    kind, width, height = _HEADER.unpack_from(data, len(PNG_START))
    if kind != b"IHDR":
        raise ValueError("not a PNG: it does not begin with its header")
    return width, height


def decode_png(data: bytes) -> NDArray[np.uint8]:
    """Return the picture as RGB of shape (H, W, 3); what is transparent is shown as if it were not.

    Raises:
        ValueError: this is not a complete PNG, or `check_size` refuses its size.
    """
    check_size(*png_size(data))
    _check_chunks(data)  # what OpenCV makes of a damaged one, and whether it prints, depends on its version
    bgr = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
    if bgr is None:
        raise ValueError("not a PNG that can be decoded")
    return np.asarray(cv2.cvtColor(bgr, cv2.COLOR_BGR2RGB), np.uint8)


def _check_chunks(data: bytes) -> None:
    """Check every chunk's CRC, up to the last."""
    at, kind = len(PNG_START), b""
    while kind != b"IEND":
        if len(data) < at + _CHUNK.size + _CRC_BYTES:
            raise ValueError("not a whole PNG: its end is missing")
        length, kind = _CHUNK.unpack_from(data, at)
        after = at + _CHUNK.size + length
        stated = data[after : after + _CRC_BYTES]
        if len(stated) < _CRC_BYTES:
            raise ValueError("not a whole PNG: its end is missing")
        if zlib.crc32(memoryview(data)[at + 4 : after]) != int.from_bytes(stated, "big"):
            raise ValueError("not a whole PNG: it is damaged")
        at = after + _CRC_BYTES


def is_png(data: bytes) -> bool:
    """Return whether this is a PNG."""
    return data.startswith(PNG_START)


def decode_image(data: bytes) -> NDArray[np.uint8]:
    """Decode a JPEG or PNG, recognised by its content, as RGB of shape (H, W, 3).

    Raises:
        ValueError: it is neither, `check_size` refuses its size, or it cannot be decoded.
    """
    return decode_png(data) if is_png(data) else decode_jpeg(data)
