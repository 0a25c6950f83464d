"""Decompresses chunks of an MCAP file within a size allowance, as a defence against decompression bombs.

This toolkit's own logs have no chunks; other tools make them (``mcap compress``, ``mcap recover``).
"""

from __future__ import annotations

import io

from mcap.exceptions import EndOfFile, McapError, UnsupportedCompressionError
from mcap.records import Chunk

LARGEST_CHUNK_BYTES = 64 << 20
"""Once unpacked; MCAP's own tools make chunks of 1 to 4 MiB."""
RATIO = 64
"""No log unpacks to so many times its size: pictures hardly shrink, steps as JSON about 15 times."""
ALWAYS_BYTES = 8 << 20
"""May be unpacked whatever the file's size."""


class Allowance:
    """The bytes to which a whole file may still unpack.

    Args:
        file_bytes: the file's size.
    """

    def __init__(self, file_bytes: int) -> None:
        self.left_bytes = ALWAYS_BYTES + RATIO * file_bytes


def unpacked(chunk: Chunk, allowance: Allowance) -> bytes:
    """Return a chunk's records, and take their size off the allowance.

    What the chunk says of its size is held against the allowance, then against what it really holds.

    Raises:
        EndOfFile: it is damaged, or does not hold as much as it says.
        McapError: it says that it holds more than it may, or its compression is not known.
    """
    stated = chunk.uncompressed_size
    if stated > min(LARGEST_CHUNK_BYTES, allowance.left_bytes):
        raise McapError(
            f"{len(chunk.data)} packed bytes claim to be {stated}: no log shrinks so far, it is not unpacked"
        )
    data: bytes = _DECOMPRESS.get(chunk.compression, _unknown)(chunk, stated)
    if len(data) != stated:
        raise EndOfFile(f"a chunk does not hold the {stated} bytes that it states")
    allowance.left_bytes -= stated
    return data


def _plain(chunk: Chunk, most: int) -> bytes:
    return bytes(chunk.data[: most + 1])


def _zstd(chunk: Chunk, most: int) -> bytes:
    try:
        import zstandard
    except ImportError as error:
        raise UnsupportedCompressionError("zstandard") from error
    try:
        with zstandard.ZstdDecompressor().stream_reader(io.BytesIO(chunk.data)) as reader:
            return bytes(reader.read(most + 1))
    except (zstandard.ZstdError, MemoryError) as error:
        raise EndOfFile(f"a damaged chunk: {error}") from error


def _lz4(chunk: Chunk, most: int) -> bytes:
    try:
        from lz4.frame import LZ4FrameDecompressor
    except ImportError as error:
        raise UnsupportedCompressionError("lz4") from error
    try:
        return bytes(LZ4FrameDecompressor().decompress(chunk.data, max_length=most + 1))
    except (RuntimeError, MemoryError) as error:
        raise EndOfFile(f"a damaged chunk: {error}") from error


def _unknown(chunk: Chunk, most: int) -> bytes:  # noqa: ARG001 -- as the others
    raise UnsupportedCompressionError(chunk.compression)


_DECOMPRESS = {"": _plain, "zstd": _zstd, "lz4": _lz4}
