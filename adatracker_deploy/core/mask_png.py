"""Class masks as palette PNGs: the pixel values are the class ids, and any viewer shows them in colour.

Written by hand because OpenCV cannot write or keep a palette, and a grey image of ids 0 to 3 looks black.
Format: PNG (ISO/IEC 15948), 8 bits, colour type 3, no interlace, every line with filter 0.
"""

from __future__ import annotations

import struct
import zlib
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Iterator

    from adatracker_deploy.core.messages import ClassMask

PALETTE = ((0, 0, 0), (60, 220, 90), (240, 150, 40), (120, 120, 130))
"""RGB of background, target, person, obstacle: `MaskClass` is the index."""

_SIGNATURE = b"\x89PNG\r\n\x1a\n"
_HEADER = struct.Struct(">IIBBBBB")
_LENGTH_AND_NAME = struct.Struct(">I4s")
_FASTEST = 1
_LARGEST_SIDE = 1 << 14


def encode_mask(mask: ClassMask) -> bytes:
    """Encode a mask of shape (H, W), values 0 to 3."""
    height, width = mask.shape
    lines = np.zeros((height, width + 1), np.uint8)
    lines[:, 1:] = mask
    return b"".join(
        (
            _SIGNATURE,
            _chunk(b"IHDR", _HEADER.pack(width, height, 8, 3, 0, 0, 0)),
            _chunk(b"PLTE", bytes(channel for colour in PALETTE for channel in colour)),
            _chunk(b"IDAT", zlib.compress(lines.tobytes(), _FASTEST)),
            _chunk(b"IEND", b""),
        )
    )


def decode_mask(png: bytes) -> ClassMask:
    """Decode what `encode_mask` wrote.

    Raises:
        ValueError: the data is not such a PNG.
    """
    try:
        chunks = dict(_chunks(png))
        width, height, *kind = _HEADER.unpack(chunks[b"IHDR"])
        if kind != [8, 3, 0, 0, 0] or max(width, height) > _LARGEST_SIDE:
            raise ValueError("not a mask: another kind of PNG")
        lines = zlib.decompressobj().decompress(chunks[b"IDAT"], height * (width + 1))
        pixels = np.frombuffer(lines, np.uint8).reshape(height, width + 1)
    except (KeyError, struct.error, zlib.error) as error:
        raise ValueError(f"not a mask: {error}") from error
    if pixels[:, 0].any():
        raise ValueError("not a mask: its lines are filtered")
    return pixels[:, 1:].copy()


def _chunk(name: bytes, body: bytes) -> bytes:
    return _LENGTH_AND_NAME.pack(len(body), name) + body + struct.pack(">I", zlib.crc32(name + body))


def _chunks(png: bytes) -> Iterator[tuple[bytes, bytes]]:
    if not png.startswith(_SIGNATURE):
        raise ValueError("not a mask: not a PNG")
    at = len(_SIGNATURE)
    while at < len(png):
        length, name = _LENGTH_AND_NAME.unpack_from(png, at)
        at += _LENGTH_AND_NAME.size
        yield name, png[at : at + length]
        at += length + 4
