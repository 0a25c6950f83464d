"""Images from strangers: read when they are pictures of a sensible size, else refused at no cost."""

import struct
import zlib

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from adatracker_deploy.perception.image import decode_image

RED = np.zeros((48, 64, 3), np.uint8)
RED[..., 0] = 250


def encoded(extension):
    return cv2.imencode(extension, RED[..., ::-1])[1].tobytes()


@pytest.mark.parametrize("extension", [".png", ".jpg"])
def test_red_is_red(extension):
    rgb = decode_image(encoded(extension))
    assert rgb.shape == RED.shape
    assert rgb.dtype == np.uint8
    assert np.abs(rgb.astype(int) - RED).max() < 12


def test_a_png_that_claims_gigabytes_of_pixels_is_refused_by_its_header():
    header = b"IHDR" + struct.pack(">IIBBBBB", 60_000, 60_000, 8, 2, 0, 0, 0)
    bomb = b"\x89PNG\r\n\x1a\n" + struct.pack(">I", 13) + header + struct.pack(">I", zlib.crc32(header))
    with pytest.raises(ValueError, match="60000"):
        decode_image(bomb + bytes(100))


@pytest.mark.parametrize("extension", [".png", ".jpg"])
def test_half_a_picture_is_none(extension):
    whole = encoded(extension)
    with pytest.raises(ValueError, match=r"not a whole (PNG|JPEG): its end is missing"):
        decode_image(whole[: -len(whole) // 3])


def test_a_png_with_a_changed_byte_is_damaged(capfd):
    whole = bytearray(encoded(".png"))
    whole[len(whole) - 20] ^= 0xFF
    with pytest.raises(ValueError, match="damaged"):
        decode_image(bytes(whole))
    assert capfd.readouterr() == ("", "")  # libpng would say so on its own, on stderr


@given(st.data())
def test_cut_or_changed_images_are_pictures_or_refused(data):
    image = bytearray(encoded(data.draw(st.sampled_from([".png", ".jpg"]))))
    for at in data.draw(st.lists(st.integers(0, len(image) - 1), max_size=5)):
        image[at] = data.draw(st.integers(0, 255))
    try:
        rgb = decode_image(bytes(image[: data.draw(st.integers(0, len(image)))]))
    except ValueError:
        return
    assert rgb.ndim == 3


@given(st.binary(max_size=300))
def test_rubbish_is_refused(rubbish):
    with pytest.raises(ValueError, match="not a"):
        decode_image(rubbish)
