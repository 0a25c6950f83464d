"""Compressed images to pixels; no image is decoded before its size is known. Pure."""

from __future__ import annotations

import struct

import cv2
import numpy as np
from numpy.typing import NDArray

from adatracker_deploy.perception.camera import check_size
from adatracker_deploy.perception.jpeg import decode_jpeg

_PNG = b"\x89PNG\r\n\x1a\n"
_HEADER = struct.Struct(">4x4sII")
"""The first chunk's length, its type, the width and the height (PNG specification, 11.2.2)."""


def decode_rgb(data: bytes) -> NDArray[np.uint8]:
    """Return a JPEG or PNG image, whatever the message calls it, as RGB of shape (H, W, 3).

    Raises:
        ValueError: it is neither, its size is none that `check_size` lets through, or it cannot be decoded.
    """
    if not data.startswith(_PNG):
        return decode_jpeg(data)
    if len(data) < len(_PNG) + _HEADER.size:
        raise ValueError("not a PNG: it ends in its header")
    kind, width, height = _HEADER.unpack_from(data, len(_PNG))
    if kind != b"IHDR":
        raise ValueError("not a PNG: it does not begin with its header")
    check_size(width, height)
    rgb = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR_RGB)
    if rgb is None:
        raise ValueError("not a PNG that can be decoded")
    return np.asarray(rgb, np.uint8)
