"""A stranger's bytes: whatever they are, a decoder answers with a sound value or with `Malformed`."""

import gc
import math
import random
import struct
import tracemalloc
from dataclasses import astuple

import pytest
from hypothesis import given
from hypothesis import strategies as st

from adatracker_deploy.core.geometry import Pose
from adatracker_deploy.core.messages import Twist
from adatracker_deploy.perception.compressed_image import IMAGE_CAP_BYTES, CompressedImage
from adatracker_quadruped.protocol import cdr as protocol
from adatracker_quadruped.protocol import messages, sport
from adatracker_quadruped.protocol.keys import attachment, parse_attachment
from adatracker_quadruped.protocol.messages import Imu, Malformed, Odometry
from adatracker_quadruped.sim.fuzz import mutate
from tests.quadruped import cdr
from tests.tiers import EXHAUSTIVE

WALK = Twist(vx=0.5, vy=-0.1, yaw_rate=0.3)
VALID = {
    messages.decode_twist: messages.encode_twist(WALK),
    messages.decode_twist_stamped: messages.encode_twist_stamped(WALK, 10**18, "base_link"),
    messages.decode_odometry: messages.encode_odometry(Odometry(Pose(1, 2, 0, 0.1, -0.1, 3), WALK, 10**18)),
    messages.decode_imu: messages.encode_imu(Imu((0.1, 0.0, 1.0), (0.0, 0.0, 0.3), (0.0, 0.0, 9.81), 10**18)),
    messages.decode_battery: messages.encode_battery(0.75, 10**18),
    messages.decode_compressed_image: messages.encode_compressed_image(
        CompressedImage(10**18, "jpeg", bytes(200))
    ),
    sport.decode_request: sport.encode_move(WALK, 5),
    parse_attachment: attachment(1, 10**18, bytes(16)),
}
CAPS = {
    decode: IMAGE_CAP_BYTES if decode is messages.decode_compressed_image else protocol.SMALL_CAP_BYTES
    for decode in VALID
}
DECODERS = pytest.mark.parametrize("decode", VALID, ids=lambda decode: decode.__name__)
MESSAGES = pytest.mark.parametrize("decode", list(VALID)[:-1], ids=lambda decode: decode.__name__)
"""All but the attachment, which has one size."""


def numbers(value):
    """Return every number in a decoded value."""
    match value:
        case bool() | str() | bytes() | memoryview() | None:
            return []
        case int() | float():
            return [value]
        case tuple():
            return [number for part in value for number in numbers(part)]
    return numbers(astuple(value)) if not isinstance(value, CompressedImage) else [value.stamp_ns]


@EXHAUSTIVE
def test_a_hundred_thousand_payloads_raise_nothing_but_malformed_and_leave_no_memory_behind():
    dice = random.Random(20261121)
    decoders = list(VALID.items())
    for decode, valid in decoders:
        decode(valid)
    accepted = 0
    tracemalloc.start()
    try:
        before, _ = tracemalloc.get_traced_memory()
        for turn in range(100_000):
            decode, valid = decoders[turn % len(decoders)]
            try:
                value = decode(mutate(valid, dice))
            except Malformed:
                continue
            accepted += 1
            assert all(map(math.isfinite, numbers(value))), value
        _, peak = tracemalloc.get_traced_memory()
        gc.collect()
        after, _ = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert 1_000 < accepted < 50_000, "the mutations are neither all refused nor harmless"
    assert peak - before < 1 << 20
    assert after - before < 64 << 10


@given(st.sampled_from(list(VALID)), st.binary(max_size=600))
def test_any_bytes_at_all_are_a_sound_value_or_malformed(decode, payload):
    try:
        value = decode(payload)
    except Malformed:
        return
    assert all(map(math.isfinite, numbers(value)))


@DECODERS
def test_a_payload_cut_anywhere_is_malformed(decode):
    valid = VALID[decode]
    for length in range(len(valid)):
        try:
            decode(valid[:length])
        except Malformed:
            continue
        pytest.fail(f"{length} of {len(valid)} bytes were taken for a whole message")


@MESSAGES
def test_a_payload_above_its_cap_is_not_even_looked_at(decode):
    with pytest.raises(Malformed, match="bytes are more than"):
        decode(VALID[decode] + bytes(CAPS[decode]))


def test_a_valid_message_above_its_cap_is_malformed():
    frame_id = "x" * protocol.SMALL_CAP_BYTES
    with pytest.raises(Malformed, match="bytes are more than"):
        messages.decode_twist_stamped(messages.encode_twist_stamped(WALK, 0, frame_id))


@MESSAGES
@pytest.mark.parametrize(
    "header", ["00020000", "00030000", "00060000", "00070000", "01010000", "ffff0000", ""]
)
def test_another_encapsulation_is_malformed(decode, header):
    """Parameter lists and XCDR2 (DDS-XTypes 1.3, table 60) are not what ROS 2 sends."""
    with pytest.raises(Malformed):
        decode(bytes.fromhex(header) + VALID[decode][4:])


@pytest.mark.parametrize("count", [201, 2**20, 2**31, 2**32 - 1])
def test_a_sequence_that_claims_more_than_there_is_allocates_nothing(count):
    payload = bytearray(VALID[messages.decode_compressed_image])
    at = payload.rindex(struct.pack("<I", 200))
    struct.pack_into("<I", payload, at, count)
    tracemalloc.start()
    try:
        with pytest.raises(Malformed):
            messages.decode_compressed_image(bytes(payload))
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert peak < 64 << 10


def test_an_image_of_the_largest_size_is_not_copied():
    head = cdr.encode(cdr.LAYOUTS["CompressedImage"], [0, 0, "camera", "jpeg", b""])
    room = IMAGE_CAP_BYTES - len(head)
    payload = cdr.encode(cdr.LAYOUTS["CompressedImage"], [0, 0, "camera", "jpeg", bytes(room)])
    assert len(payload) == IMAGE_CAP_BYTES
    tracemalloc.start()
    try:
        image = messages.decode_compressed_image(payload)
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert len(image.data) == room
    assert peak < 1 << 20


def test_text_that_is_no_utf_8_is_malformed():
    payload = VALID[messages.decode_twist_stamped].replace(b"base_link", b"base\xff\xfe\xfd\xfc\xfb")
    with pytest.raises(Malformed):
        messages.decode_twist_stamped(payload)
