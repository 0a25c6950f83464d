"""Decodes untrusted PNG and JPEG images; the size is checked before decoding. Pure."""

from __future__ import annotations

from typing import TYPE_CHECKING

from adatracker_deploy.perception.jpeg import decode_jpeg
from adatracker_deploy.perception.png import PNG_START, decode_png

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


def is_png(data: bytes) -> bool:
    """Return whether this is a PNG."""
    return data.startswith(PNG_START)


def decode_image(data: bytes) -> NDArray[np.uint8]:
    """Decode a JPEG or PNG, recognised by its content, as RGB of shape (H, W, 3).

    Raises:
        ValueError: it is neither, `check_size` refuses its size, or it cannot be decoded.
    """
    return decode_png(data) if is_png(data) else decode_jpeg(data)
