"""Arrays in MessagePack as openpi's client and server write them (``openpi_client/msgpack_numpy.py``).

An array is a map of bytes keys: ``__ndarray__``, ``data``, ``dtype`` (numpy's, such as ``<f4``) and
``shape``; a numpy number likewise, ``__npgeneric__``. Objects are never unpacked.
"""

from __future__ import annotations

import re
from typing import Any

import msgspec
import numpy as np

LARGEST_BYTES = 64 << 20
"""Largest message; a picture of 1920 x 1080 is 6 MB."""
_KINDS = "biuf"
"""Kinds of dtype that are taken: bool, signed, unsigned, float."""
_DTYPE = re.compile(rf"[<>|=]?[{_KINDS}][0-9]{{1,2}}")


def pack(value: Any) -> bytes:
    """Return a value of maps, lists, numbers, text and arrays as MessagePack."""
    return msgspec.msgpack.encode(value, enc_hook=_plain)


def unpack(data: bytes) -> Any:
    """Return what is in a message; arrays are read-only views of it.

    Raises:
        ValueError: it is malformed.
    """
    if len(data) > LARGEST_BYTES:
        raise ValueError(f"a message of {len(data)} bytes")
    try:
        return _restored(msgspec.msgpack.decode(data))
    except (msgspec.DecodeError, TypeError, KeyError, OverflowError, RecursionError) as error:
        raise ValueError(f"no message: {error}") from error


def _plain(value: Any) -> Any:
    if isinstance(value, np.ndarray) and value.dtype.kind in _KINDS:
        return {
            b"__ndarray__": True,
            b"data": value.tobytes(),
            b"dtype": value.dtype.str,
            b"shape": value.shape,
        }
    if isinstance(value, np.generic) and value.dtype.kind in _KINDS:
        return {b"__npgeneric__": True, b"data": value.item(), b"dtype": value.dtype.str}
    raise TypeError(f"{type(value).__name__} cannot be packed")


def _restored(value: Any) -> Any:
    if isinstance(value, list):
        return [_restored(each) for each in value]
    if not isinstance(value, dict):
        return value
    if b"__ndarray__" in value:
        array = np.frombuffer(value[b"data"], _dtype(value[b"dtype"]))
        return array.reshape([int(side) for side in value[b"shape"]])
    if b"__npgeneric__" in value:
        return _dtype(value[b"dtype"]).type(value[b"data"])
    return {key: _restored(each) for key, each in value.items()}


def _dtype(name: str) -> np.dtype[Any]:
    if not _DTYPE.fullmatch(name):
        raise ValueError(f"an array of {name[:20]!r}")
    return np.dtype(name)
