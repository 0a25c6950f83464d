"""The truth of a simulated frame arrives as it was sent, and nothing else passes for one."""

from __future__ import annotations

import dataclasses
import json
import struct
from typing import get_args

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from adatracker_deploy.core.geometry import Pose
from adatracker_deploy.core.mask_png import encode_mask
from adatracker_deploy.core.messages import Contact, Truth
from adatracker_deploy.perception.truth_wire import decode_truth, encode_truth

NUMBERS = st.floats(-1e6, 1e6)
POSES = st.builds(Pose, *[NUMBERS] * 6)
MASKS = arrays.arrays(np.uint8, st.tuples(st.integers(1, 20), st.integers(1, 20)), elements=st.integers(0, 3))
TRUTHS = st.builds(
    Truth,
    mask=MASKS,
    robot=POSES,
    camera=POSES,
    target_xy=st.tuples(NUMBERS, NUMBERS),
    distance_m=NUMBERS,
    bearing_rad=NUMBERS,
    contact=st.sampled_from([None, *get_args(Contact)]),
)
ONE = Truth(np.ones((4, 6), np.uint8), Pose(1.0), Pose(2.0), (3.0, 4.0), 5.0, 0.5)


def encoded(mask_png=None, **changes):
    """Return `ONE` with other values in its header, or with another mask."""
    data = encode_truth(ONE)
    (length,) = struct.unpack_from("<I", data)
    text = json.dumps({**json.loads(data[4 : 4 + length]), **changes}).encode()
    return struct.pack("<I", len(text)) + text + (data[4 + length :] if mask_png is None else mask_png)


@given(TRUTHS)
def test_a_truth_arrives_as_it_was_sent(truth):
    arrived = decode_truth(encode_truth(truth))
    assert np.array_equal(arrived.mask, truth.mask)
    assert dataclasses.replace(arrived, mask=truth.mask) == truth


@given(st.data())
def test_a_damaged_truth_is_refused_or_is_still_a_truth(data):
    damaged = bytearray(encode_truth(ONE))
    for place in data.draw(st.lists(st.integers(0, len(damaged) - 1), min_size=1, max_size=4)):
        damaged[place] = data.draw(st.integers(0, 255))
    try:
        truth = decode_truth(bytes(damaged[: data.draw(st.integers(0, len(damaged)))]))
    except ValueError:
        return
    assert truth.mask.dtype == np.uint8
    assert truth.mask.ndim == 2


@given(st.binary(max_size=100))
def test_rubbish_is_refused(data):
    with pytest.raises(ValueError, match="not a truth"):
        decode_truth(data)


@pytest.mark.parametrize(
    "data",
    [
        b"\0" * ((1 << 20) + 1),
        struct.pack("<I", 100_000) + b"[" * 100_000,
        encoded(distance_m="near"),
        encoded(distance_m=float("nan")),
        encoded(robot={"x": float("inf")}),
        encoded(weight_kg=80),
        encoded(target_xy=[1.0]),
        encoded(mask_png=b"no mask"),
        encoded(mask_png=encode_mask(np.zeros((0, 4), np.uint8))),
    ],
    ids=["huge", "deep", "text", "nan", "infinite", "unknown", "short", "no mask", "empty mask"],
)
def test_what_is_no_truth_is_refused_as_such(data):
    with pytest.raises(ValueError, match="not a truth"):
        decode_truth(data)


def test_a_mask_holds_known_classes_only():
    strange = encoded(mask_png=encode_mask(np.full((4, 6), 9, np.uint8)))
    with pytest.raises(ValueError, match="not a truth: unknown classes in its mask"):
        decode_truth(strange)
