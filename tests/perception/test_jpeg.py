"""Pictures of strangers are looked at before they are decoded, and come out whole or not at all."""

from __future__ import annotations

import struct

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from streams import jpeg, picture

from adatracker_deploy.core.camera import LARGEST_SIDE
from adatracker_deploy.perception.jpeg import decode_jpeg, jpeg_size

SIZE_MARKER = b"\xff\xc0"


def stating(width, height):
    """Return a JPEG whose header states another size than it has."""
    data = bytearray(jpeg(picture()))
    struct.pack_into(">HH", data, data.index(SIZE_MARKER) + 5, height, width)
    return bytes(data)


@given(st.integers(1, 300), st.integers(1, 300), st.booleans(), st.booleans())
def test_the_size_is_known_before_decoding(width, height, progressive, grey):
    shape = (height, width) if grey else (height, width, 3)
    flags = (cv2.IMWRITE_JPEG_PROGRESSIVE, int(progressive))
    data = cv2.imencode(".jpg", np.zeros(shape, np.uint8), flags)[1].tobytes()
    assert jpeg_size(data) == (width, height)
    assert decode_jpeg(data).shape == (height, width, 3)


def test_red_stays_red():
    red = np.full((16, 16, 3), (250, 10, 20), np.uint8)
    assert np.abs(decode_jpeg(jpeg(red)).astype(int) - red).max() < 12


@pytest.mark.parametrize("size", [(LARGEST_SIDE + 1, 48), (64, 65535), (0, 48), (64, 0)])
def test_a_picture_of_no_or_of_monstrous_size_is_refused(size):
    with pytest.raises(ValueError, match=f"{size[0]}x{size[1]} px"):
        decode_jpeg(stating(*size))


@given(st.data())
def test_a_picture_that_was_cut_short_is_refused_wherever_it_was_cut(data):
    whole = jpeg(picture())
    with pytest.raises(ValueError, match="JPEG"):
        decode_jpeg(whole[: data.draw(st.integers(0, len(whole) - 1))])


@given(st.binary(max_size=300), st.booleans())
def test_rubbish_is_refused(data, begins_well):
    with pytest.raises(ValueError, match=r"JPEG|px"):
        decode_jpeg((b"\xff\xd8\xff" if begins_well else b"") + data)
