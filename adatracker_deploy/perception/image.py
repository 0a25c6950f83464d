"""PNG and JPEG pictures of strangers: no picture is decoded before its size is known. Pure."""

from __future__ import annotations

from typing import TYPE_CHECKING

from adatracker_deploy.perception.jpeg import decode_jpeg
from adatracker_deploy.perception.png import PNG_START, decode_png

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


def is_png(data: bytes) -> bool:
    """Tell a PNG picture from all others."""
    return data.startswith(PNG_START)


def decode_image(data: bytes) -> NDArray[np.uint8]:
    """Return a JPEG or PNG picture, whatever it is called, as RGB of shape (H, W, 3).

    Raises:
        ValueError: it is neither, its size is none that `check_size` lets through, or it cannot be decoded.
    """
    return decode_png(data) if is_png(data) else decode_jpeg(data)
