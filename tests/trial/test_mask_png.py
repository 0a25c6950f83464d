"""Masks as palette PNGs."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from adatracker_deploy.core.mask_png import PALETTE, decode_mask, encode_mask
from adatracker_deploy.core.messages import MaskClass

masks = arrays.arrays(
    np.uint8, arrays.array_shapes(min_dims=2, max_dims=2, max_side=40), elements=st.integers(0, 3)
)


@given(masks)
def test_the_class_ids_come_back_exactly(mask):
    assert np.array_equal(decode_mask(encode_mask(mask)), mask)


@given(masks)
def test_any_other_viewer_sees_the_palettes_colours(mask):
    seen = cv2.imdecode(np.frombuffer(encode_mask(mask), np.uint8), cv2.IMREAD_COLOR)[..., ::-1]
    assert np.array_equal(seen, np.array(PALETTE, np.uint8)[mask])


def test_every_class_has_its_own_colour():
    assert len(set(PALETTE)) == len(MaskClass)


def test_other_pngs_are_refused():
    _, grey = cv2.imencode(".png", np.zeros((4, 4), np.uint8))
    with pytest.raises(ValueError, match="another kind of PNG"):
        decode_mask(grey.tobytes())


@given(st.binary(max_size=80), st.integers(0, 90))
def test_damage_is_refused_or_harmless(noise, at):
    png = encode_mask(np.ones((5, 7), np.uint8))
    try:
        mask = decode_mask(png[:at] + noise + png[at + len(noise) :])
    except ValueError:
        return
    assert mask.dtype == np.uint8
