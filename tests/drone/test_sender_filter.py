"""The filter of senders on a MAVLink link admits only the autopilot; tested without a socket."""

import pytest
from hypothesis import given
from hypothesis import strategies as st
from packing import KEY, heartbeat, packer
from pymavlink.dialects.v20 import common as mavlink

from adatracker_deploy.core.errors import UsageError
from adatracker_drone.adapter.sender_filter import Guard, Ignored
from adatracker_drone.protocol.connection import Connection
from adatracker_drone.protocol.packets import EPOCH_2015_NS, HEARD, split
from adatracker_drone.protocol.signing import Signer, read_key

DRONE, OTHER = ("10.0.0.2", 14580), ("10.0.0.66", 14580)
NOW_NS = EPOCH_2015_NS + 10**18
TIME = 10**14
"""Time in a signature."""


def attitude(**sender):
    return bytes(mavlink.MAVLink_attitude_message(0, 0, 0, 0, 0, 0, 0).pack(packer(**sender)))


def pinned(**made):
    guard = Guard(1, **made)
    key = KEY if made else None
    assert guard.admit(heartbeat(key=key, time=TIME), DRONE, NOW_NS) != b""
    return guard


def test_nothing_passes_before_the_autopilots_heartbeat_has_decided_whose_link_it_is():
    guard = Guard(1)
    assert guard.admit(attitude(), OTHER, NOW_NS) == b""
    assert guard.admit(heartbeat(system=2), OTHER, NOW_NS) == b""
    assert guard.admit(heartbeat(component=154), OTHER, NOW_NS) == b""
    assert guard.peer is None
    assert guard.admit(heartbeat(), DRONE, NOW_NS) == heartbeat()
    assert guard.peer == DRONE
    assert guard.admit(attitude(), DRONE, NOW_NS) == attitude()


def test_a_heartbeat_that_is_not_whole_decides_nothing():
    guard = Guard(1)
    broken = bytearray(heartbeat())
    broken[-1] ^= 1
    assert guard.admit(bytes(broken), DRONE, NOW_NS) == b""
    assert guard.peer is None


@pytest.mark.parametrize("sender", [OTHER, (DRONE[0], DRONE[1] + 1)], ids=["address", "port"])
def test_a_second_talker_with_the_same_id_is_ignored_counted_and_told_of(sender):
    guard = pinned()
    notices = []
    for _ in range(12):
        assert guard.admit(heartbeat(), sender, NOW_NS) == b""
        notices += guard.take_notices()
    assert guard.peer == DRONE
    assert guard.ignored[Ignored.STRANGER] == 12
    first, tenth = notices
    assert first.startswith("MAVLink: 1 ignored from an address that is not the autopilot's")
    assert tenth.startswith("MAVLink: 10 ignored")
    assert f"{sender[0]}:{sender[1]}" in first
    assert "12 from an address" in guard.offences


def test_others_on_the_autopilots_own_link_are_left_alone_without_a_word():
    guard = pinned()
    for sender in ({"system": 255, "component": 190}, {"component": 154}):
        assert guard.admit(heartbeat(**sender), DRONE, NOW_NS) == b""
    assert guard.ignored[Ignored.OTHER] == 2
    assert guard.take_notices() == ()
    assert guard.offences == ""


def test_a_message_that_nobody_here_needs_does_not_pass():
    order = mavlink.MAVLink_command_long_message(1, 1, 400, 0, 1, 0, 0, 0, 0, 0, 0).pack(packer())
    guard = pinned()
    assert guard.admit(bytes(order), DRONE, NOW_NS) == b""
    assert guard.ignored[Ignored.OTHER] == 1


@pytest.mark.parametrize("text", [b"\x1b[2J", b"caf\xe9", b"a\r\nb"])
def test_a_text_that_a_terminal_would_obey_does_not_pass(text):
    guard = pinned()
    for message in (
        mavlink.MAVLink_statustext_message(2, text),
        mavlink.MAVLink_param_value_message(text, 1.0, 9, 1, 0),
    ):
        for old in (False, True):
            frame = bytes(message.pack(packer(), force_mavlink1=old))
            assert guard.admit(frame, DRONE, NOW_NS) == b""
    assert guard.ignored[Ignored.MALFORMED] == 4


@pytest.mark.parametrize("text", [b"Arming denied: low battery\t", b"", b"x" * 50])
def test_a_plain_text_passes(text):
    frame = bytes(mavlink.MAVLink_statustext_message(2, text).pack(packer()))
    assert pinned().admit(frame, DRONE, NOW_NS) == frame


def test_bytes_that_are_no_mavlink_are_told_of_and_do_not_hide_the_frame_before_them():
    guard = pinned()
    assert guard.admit(attitude() + b"GET / HTTP/1.1", DRONE, NOW_NS) == attitude()
    assert guard.ignored[Ignored.MALFORMED] == 1
    assert guard.take_notices()


def test_a_peer_that_is_dialled_is_the_only_one_from_the_start():
    guard = Guard(1, DRONE)
    assert guard.admit(heartbeat(), OTHER, NOW_NS) == b""
    assert guard.admit(heartbeat(), DRONE, NOW_NS) == heartbeat()


@given(
    st.lists(st.tuples(st.binary(max_size=300), st.sampled_from([DRONE, OTHER]), st.booleans()), max_size=20)
)
def test_whatever_comes_only_whole_frames_of_the_autopilots_own_pass(history):
    guard = pinned()
    for rubbish, sender, behind_a_frame in history:
        passed = guard.admit(attitude() + rubbish if behind_a_frame else rubbish, sender, NOW_NS)
        packets = list(split(passed))
        assert b"".join(packet.data for packet in packets) == passed
        assert all((each.system, each.component) == (1, 1) and each.is_whole for each in packets)
        assert all(each.message in HEARD for each in packets)
        assert sender == DRONE or not passed
        assert guard.peer == DRONE
    assert len(guard.take_notices()) <= 3, "a flood fills no log"


# Signatures


def test_with_a_key_only_what_is_signed_with_it_decides_and_passes():
    guard = Guard(1, signer=Signer(KEY))
    for forged in (heartbeat(), heartbeat(key=KEY[::-1], time=TIME)):
        assert guard.admit(forged, OTHER, NOW_NS) == b""
    assert guard.peer is None
    assert guard.ignored[Ignored.FORGED] == 2
    good = heartbeat(key=KEY, time=TIME)
    assert guard.admit(good, DRONE, NOW_NS) == good
    assert guard.admit(attitude(), DRONE, NOW_NS) == b""
    assert "without a valid signature" in guard.offences


def test_a_packet_that_was_heard_before_is_not_believed_again():
    guard = pinned(signer=Signer(KEY))
    assert guard.admit(heartbeat(key=KEY, time=TIME), DRONE, NOW_NS) == b""
    assert guard.admit(heartbeat(key=KEY, time=TIME + 1), DRONE, NOW_NS) != b""


def test_what_was_recorded_more_than_a_minute_ago_opens_no_link():
    minute = 6_000_000
    late = heartbeat(key=KEY, time=TIME - minute - 1)
    assert Guard(1, signer=Signer(KEY)).admit(late, DRONE, NOW_NS) == b""
    just = heartbeat(key=KEY, time=TIME - minute)
    assert Guard(1, signer=Signer(KEY)).admit(just, DRONE, NOW_NS) == just


def test_a_forged_time_does_not_lock_the_autopilot_out():
    guard = pinned(signer=Signer(KEY))
    guard.admit(heartbeat(key=KEY[::-1], time=2**48 - 1), DRONE, NOW_NS)
    assert guard.admit(heartbeat(key=KEY, time=TIME + 1), DRONE, NOW_NS) != b""


def test_one_who_has_the_key_cannot_fill_the_memory_with_links():
    signer = Signer(KEY)
    believed = [
        signer.believes(next(split(heartbeat(key=KEY, link=link, time=TIME))), NOW_NS) for link in range(256)
    ]
    assert sum(believed) == 16


@given(st.lists(st.integers(0, 2 * 10**18), min_size=2, max_size=20))
def test_whatever_the_clock_does_no_two_packets_go_out_with_the_same_time(clock):
    signer, guard = Signer(KEY), packer(key=KEY)
    for unix_ns in clock:  # pymavlink refuses a time that is not greater than the last
        signed = signer.sign(heartbeat(), EPOCH_2015_NS + unix_ns)
        guard.signing.timestamp = 0
        guard.decode(bytearray(signed))


# The key's file


def key_file(folder, content=KEY, mode=0o600):
    path = folder / "mavlink.key"
    path.write_bytes(content)
    path.chmod(mode)
    return str(path)


def test_a_key_is_32_bytes_that_only_the_owner_can_read(tmp_path):
    assert read_key(key_file(tmp_path)) == KEY


@pytest.mark.parametrize("mode", [0o640, 0o604, 0o620, 0o602, 0o777])
def test_a_key_that_others_can_read_or_change_is_refused(tmp_path, mode):
    with pytest.raises(UsageError, match="chmod 600"):
        read_key(key_file(tmp_path, mode=mode))


@pytest.mark.parametrize("content", [b"", KEY[:31], KEY + b"\n", bytes(32), KEY.hex().encode()])
def test_a_file_that_holds_no_key_is_refused(tmp_path, content):
    with pytest.raises(UsageError, match="signing_key"):
        read_key(key_file(tmp_path, content))


def test_a_key_that_is_not_there_or_no_file_is_named(tmp_path):
    for path in (tmp_path / "none", tmp_path):
        with pytest.raises(UsageError, match=str(path)):
            read_key(str(path))


@pytest.mark.parametrize("url", ["tcpout://10.0.0.2:5760", "serial:///dev/ttyACM0:57600"])
def test_a_key_where_nothing_could_be_signed_is_refused(url):
    with pytest.raises(UsageError, match="signs nothing"):
        Connection(url=url, signing_key="drone.key")
