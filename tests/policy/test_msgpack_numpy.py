"""Arrays in messages come back as they were, and nothing else is made of any bytes."""

from __future__ import annotations

import contextlib

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from adatracker_deploy.policy import msgpack_numpy
from adatracker_deploy.policy.msgpack_numpy import pack, unpack

DTYPES = [np.uint8, np.float16, np.float32, np.int64, np.bool_, np.dtype(">f4")]
VALUES = st.recursive(
    st.none()
    | st.booleans()
    | st.integers(-(2**63), 2**64 - 1)
    | st.floats(allow_nan=False)
    | st.text()
    | arrays.arrays(st.sampled_from(DTYPES), arrays.array_shapes(min_side=0)),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(), inner, max_size=3),
    max_leaves=8,
)


def same(a, b):
    if isinstance(a, np.ndarray):
        return a.dtype == b.dtype and np.array_equal(a, b, equal_nan=a.dtype.kind == "f")
    if isinstance(a, dict):
        return a.keys() == b.keys() and all(same(a[key], b[key]) for key in a)
    if isinstance(a, list):
        return len(a) == len(b) and all(map(same, a, b))
    return a == b


@given(VALUES)
def test_whatever_is_packed_is_unpacked(value):
    assert same(value, unpack(pack(value)))


@given(st.sampled_from(DTYPES[:-1]))
def test_numbers_of_numpy_keep_their_kind(dtype):
    number = np.dtype(dtype).type(1)
    assert type(unpack(pack({"n": number}))["n"]) is type(number)


@given(st.binary(max_size=200))
def test_any_bytes_are_a_message_or_refused(data):
    with contextlib.suppress(ValueError):
        unpack(data)


@given(
    st.fixed_dictionaries(
        {
            b"__ndarray__": VALUES,
            b"data": st.binary(max_size=16),
            b"dtype": VALUES | st.text("<>|iufbOV0248,()", max_size=4),
            b"shape": st.lists(st.integers(-3, 2**40), max_size=3) | VALUES,
        }
    )
)
def test_any_array_is_one_of_numbers_or_refused(said):
    with contextlib.suppress(ValueError):
        assert unpack(pack(said)).dtype.kind in "biuf"


def test_objects_are_neither_packed_nor_unpacked():
    with pytest.raises(TypeError):
        pack(np.array([object()]))
    with pytest.raises(ValueError, match=r"an array of '\|O8'"):
        unpack(pack({b"__ndarray__": True, b"data": bytes(8), b"dtype": "|O8", b"shape": [1]}))


def test_a_message_has_a_greatest_size(monkeypatch):
    monkeypatch.setattr(msgpack_numpy, "LARGEST_BYTES", 10)
    with pytest.raises(ValueError, match="a message of 11 bytes"):
        unpack(bytes(11))
