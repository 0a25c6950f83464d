"""Decodes untrusted JPEGs; the size is checked before decoding."""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING

import cv2
import numpy as np
from numpy.typing import NDArray

from adatracker_deploy.core.camera import check_size
from adatracker_deploy.core.messages import Frame

if TYPE_CHECKING:
    from adatracker_deploy.core.messages import Shot

_START, _END = b"\xff\xd8", b"\xff\xd9"
_START_OF_SCAN = 0xDA
_SIZE_MARKERS = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}
"""SOF0 to SOF15; the three others of that range are DHT, JPG and DAC (ITU-T T.81, table B.1)."""
_SEGMENT = struct.Struct(">BBH")
_SIZE = struct.Struct(">BHH")


def jpeg_size(data: bytes) -> tuple[int, int]:
    """Return width and height, px, as the frame header states them (ITU-T T.81, B.2.2).

    Raises:
        ValueError: this is not a JPEG.
    """
    if not data.startswith(_START):
        raise ValueError("not a JPEG")
    at = len(_START)
    try:
        while True:
            prefix, marker, length = _SEGMENT.unpack_from(data, at)
            if prefix != 0xFF or marker == _START_OF_SCAN or length < 2:
                raise ValueError("not a JPEG: it states no size")
            if marker in _SIZE_MARKERS:
                _, height, width = _SIZE.unpack_from(data, at + _SEGMENT.size)
                return width, height
            at += 2 + length
    except struct.error as error:
        raise ValueError("not a JPEG: it ends in its header") from error


def developed(shot: Shot) -> Frame:
    """Return a simulated camera's picture, decoded."""
    return Frame(decode_jpeg(shot.jpeg), shot.t_ns, shot.seq, shot.truth, shot.jpeg)


def decode_jpeg(data: bytes) -> NDArray[np.uint8]:
    """Return the image as RGB of shape (H, W, 3).

    Raises:
        ValueError: this is not a complete JPEG, or `check_size` refuses its size.
    """
    check_size(*jpeg_size(data))
    # OpenCV 4 fills the end of a truncated JPEG with grey. Some encoders pad after the end.
    if _END not in data[-64:]:
        raise ValueError("not a whole JPEG: its end is missing")
    bgr = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
    if bgr is None:
        raise ValueError("not a JPEG that can be decoded")
    return np.asarray(cv2.cvtColor(bgr, cv2.COLOR_BGR2RGB), np.uint8)
