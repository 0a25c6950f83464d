"""MAVLink's frames and signatures, against pymavlink's own."""

import pytest
from hypothesis import given
from hypothesis import strategies as st
from packing import KEY, heartbeat, packer
from pymavlink.dialects.v20 import common as mavlink
from pymavlink.dialects.v20 import development

from adatracker_drone.protocol.packets import (
    CURRENT_MODE,
    EVENT,
    HEARD,
    HEARTBEAT,
    SIGNATURE_BYTES,
    is_signed_with,
    pack,
    sign,
    signature_of,
    signing_time,
    split,
)

TIMES = st.integers(0, 2**48 - 1)


EITHER = st.sampled_from([1, 2])
"""MAVLink's versions."""


@st.composite
def frames(draw, version=EITHER, **sender):
    """A frame of any message in the dialect, with any bytes in its fields."""
    kind = mavlink.mavlink_map[draw(st.sampled_from(sorted(mavlink.mavlink_map)))]
    old = draw(version) == 1 and kind.id < 256
    size = kind.unpacker.size
    payload = draw(st.binary(min_size=size, max_size=size))
    made = packer(draw(st.integers(0, 255)), draw(st.integers(0, 255)), **sender)
    message = mavlink.MAVLink_message(kind.id, kind.msgname)
    return bytes(message._pack(made, kind.crc_extra, payload, force_mavlink1=old))


def test_the_messages_that_are_heard_are_the_dialects():
    known = mavlink.mavlink_map | {CURRENT_MODE: development.mavlink_map[CURRENT_MODE]}
    others = {
        number: extra for number, extra in HEARD.items() if number != EVENT
    }  # in no dialect of pymavlink
    assert {number: known[number].crc_extra for number in others} == others


@given(st.lists(frames(), max_size=4))
def test_a_datagram_falls_into_its_frames(sent):
    found = list(split(b"".join(sent)))
    assert [packet.data for packet in found] == sent
    for packet in found:
        message = mavlink.MAVLink(None).decode(bytearray(packet.data))
        assert (packet.system, packet.component) == (message.get_srcSystem(), message.get_srcComponent())
        assert packet.message == message.get_msgId()
        assert packet.is_whole == (packet.message in HEARD)


@given(frames(version=st.just(2)))
def test_what_is_packed_here_is_what_pymavlink_packs(frame):
    kind = mavlink.mavlink_map[int.from_bytes(frame[7:10], "little")]
    made = pack(kind.id, frame[10:-2], kind.crc_extra, system=frame[5], component=frame[6], number=frame[4])
    assert made == frame


@given(frames(), st.data())
def test_a_frame_with_a_byte_changed_is_not_whole(frame, data):
    at = data.draw(st.integers(0, len(frame) - 1))
    changed = bytearray(frame)
    changed[at] ^= data.draw(st.integers(1, 255))
    assert not any(packet.is_whole and packet.data == bytes(changed) for packet in split(bytes(changed)))


@given(st.binary(max_size=400))
def test_any_bytes_at_all_are_frames_from_their_beginning_or_none(data):
    assert data.startswith(b"".join(packet.data for packet in split(data)))


@given(frames(version=st.just(2)), TIMES, st.integers(0, 255))
def test_what_is_signed_here_pymavlink_believes(frame, time, link):
    signed = sign(frame, KEY, link, time)
    assert len(signed) == len(frame) + SIGNATURE_BYTES
    reader = packer(key=KEY, time=time)
    message = reader.decode(bytearray(signed))  # which checks checksum and signature
    assert message.get_msgbuf()[10:-15] == frame[10:-2]
    (packet,) = split(signed)
    assert signature_of(packet) == (link, time)


@given(frames(version=st.just(2), key=KEY, link=7, time=12345))
def test_what_pymavlink_signs_is_believed_here(frame):
    (packet,) = split(frame)
    assert packet.signed
    assert signature_of(packet) == (7, 12345)
    assert is_signed_with(packet, KEY)
    assert packet.is_whole == (packet.message in HEARD)


@given(st.data())
def test_a_signed_frame_with_any_bit_changed_is_not_believed(data):
    frame = bytearray(heartbeat(key=KEY))
    at = data.draw(st.integers(0, len(frame) * 8 - 1))
    frame[at // 8] ^= 1 << at % 8
    assert not any(packet.signed and is_signed_with(packet, KEY) for packet in split(bytes(frame)))


def test_another_key_is_not_believed():
    (packet,) = split(heartbeat(key=KEY))
    assert packet.message == HEARTBEAT
    assert not is_signed_with(packet, KEY[::-1])


@pytest.mark.parametrize(("unix_ns", "time"), [(0, 0), (1_420_070_400_000_000_000 + 30_000, 3)])
def test_a_signatures_time_is_in_tens_of_microseconds_since_2015(unix_ns, time):
    assert signing_time(unix_ns) == time
