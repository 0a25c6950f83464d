"""AgileX protocol v1: percentages, a count and a checksum in every frame."""

import struct

import cantools
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from shipped_roles import codec_of, frame

from adatracker_deploy.core.messages import Twist
from adatracker_wheeled.protocol.dbc import agilex_v1, find_dbc
from adatracker_wheeled.protocol.frames import BaseStatus, CanFrame, Demand, Malformed, Reading

# The manual's own examples: "forward at 0.15 m/s", "take command while standing still".
FORWARD = bytes.fromhex("01 00 0a 00 00 00 00 44")
STANDING = bytes.fromhex("01 00 00 00 00 00 00 3a")


CODEC = codec_of("scout_v1")


def summed(can_id, data7):
    return data7 + bytes([(can_id // 256 + can_id % 256 + 8 + sum(data7)) % 256])


def test_commands_are_the_manuals_examples():
    assert CODEC.command(Twist(vx=0.15))[1] == (CanFrame(0x130, FORWARD),)
    assert CODEC.command(Twist())[1] == (CanFrame(0x130, STANDING),)
    assert CODEC.enable() == (CanFrame(0x130, STANDING),)


def test_a_turn_at_the_second_count_is_the_sdks_own_vector():
    frames = CODEC.command(Twist(yaw_rate=0.05235), count=1)[1]
    assert frames == (CanFrame(0x130, bytes.fromhex("01 00 00 0a 00 00 01 45")),)


def test_giving_up_control_is_the_mode_byte_at_zero():
    assert CODEC.disable() == (CanFrame(0x130, bytes.fromhex("00 00 00 00 00 00 00 39")),)


@settings(deadline=None)
@given(can_id=st.integers(0, 0x7FF), data=st.binary(min_size=7, max_size=7), last=st.integers(0, 255))
def test_the_checksum_does_not_depend_on_its_own_byte(can_id, data, last):
    assert summed(can_id, data)[-1] == agilex_v1(can_id, data + bytes([last]))


@settings(deadline=None)
@given(count=st.integers(0, 10_000), vx=st.floats(-1.5, 1.5), yaw_rate=st.floats(-0.5235, 0.5235))
def test_every_command_is_counted_summed_and_within_half_a_percent(count, vx, yaw_rate):
    said, (sent,) = CODEC.command(Twist(vx=vx, yaw_rate=yaw_rate), count)
    assert sent.data[6] == count % 256
    assert sent.data == summed(0x130, sent.data[:7])
    assert abs(said.vx - vx) <= 0.0075 + 1e-9
    assert abs(said.yaw_rate - yaw_rate) <= 0.0027
    assert CODEC.parse_command(sent).twist == said


def test_state_and_motion_are_read_as_packed():
    status = CODEC.parse(frame(0x151, summed(0x151, struct.pack(">BBHHB", 0, 1, 255, 0x0101, 9)))).status
    assert (status.mode, status.volts, status.count) == ("ours", 25.5, 9)
    assert status.fault == "battery under-voltage, command checksum"
    motion = CODEC.parse(frame(0x131, summed(0x131, struct.pack(">hhhB", -250, 100, 0, 0)))).motion
    assert (motion.vx, motion.yaw_rate) == pytest.approx((-0.25, 0.1))


@settings(deadline=None)
@given(flip=st.integers(0, 63))
def test_one_wrong_bit_anywhere_is_malformed(flip):
    data = bytearray(summed(0x131, struct.pack(">hhhB", -250, 100, 0, 5)))
    data[flip // 8] ^= 1 << flip % 8
    with pytest.raises(Malformed, match="wrong checksum"):
        CODEC.parse(frame(0x131, data))


def test_each_command_also_asks_for_control_and_the_last_one_gives_it_up():
    assert CODEC.parse_command(frame(0x130, FORWARD)) == Demand(twist=Twist(vx=0.15), enable=True)
    assert CODEC.parse_command(CODEC.disable()[0]) == Demand(disable=True)


def test_what_the_simulator_says_is_what_is_heard():
    reading = Reading(status=BaseStatus(mode="ours", volts=24.0), motion=Twist(vx=0.5, yaw_rate=-0.1))
    (state,) = CODEC.status_frames(reading, count=300)
    (motion,) = CODEC.feedback_frames(reading)
    assert CODEC.parse(state).status.count == 300 - 256
    assert CODEC.parse(motion).motion == reading.motion
    assert CODEC.battery_frames(reading) == ()


@pytest.mark.parametrize("motor", [1, 2, 3, 4])
def test_the_dbc_also_tells_of_each_motor(motor):
    dbc = cantools.database.load_file(find_dbc("agilex_v1.dbc"))
    said = dbc.decode_message(
        0x1FF + motor, summed(0x1FF + motor, struct.pack(">hhbbB", 35, -120, 40, -5, 9))
    )
    assert said["Current"] == pytest.approx(3.5)
    assert (said["Speed"], said["DriverTemperature"], said["MotorTemperature"]) == (-120, 40, -5)
