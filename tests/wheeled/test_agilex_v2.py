"""Every byte of AgileX protocol v2, against vectors packed by hand from its published layouts."""

import math
import struct

import cantools
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from shipped_roles import codec_of, frame

from adatracker_deploy.core.messages import Twist
from adatracker_wheeled.protocol.dbc import Database, find_dbc
from adatracker_wheeled.protocol.frames import BaseStatus, CanFrame, Demand, Malformed, Reading

i16 = st.integers(-(2**15), 2**15 - 1)
i32 = st.integers(-(2**31), 2**31 - 1)
AGILEX_V2 = ("scout", "tracer", "hunter")
SCOUT, HUNTER = codec_of("scout"), codec_of("hunter")


def test_a_command_is_four_signed_thousandths_big_endian():
    said, frames = SCOUT.command(Twist(vx=0.15, yaw_rate=-0.2))
    assert frames == (CanFrame(0x111, bytes.fromhex("0096 ff38 0000 0000")),)
    assert said == Twist(vx=0.15, yaw_rate=-0.2)


def test_a_hunter_steers_in_the_last_two_bytes_and_leaves_the_yaw_rate_out():
    said, frames = HUNTER.command(Twist(vx=1.0, yaw_rate=10.0))
    assert frames == (CanFrame(0x111, bytes.fromhex("03e8 0000 0000 0244")),)  # 0.58 rad, its largest
    assert 0 < said.yaw_rate < 10.0


@pytest.mark.parametrize("name", AGILEX_V2)
def test_requests_are_one_byte_each(name):
    codec = codec_of(name)
    assert codec.enable() == (CanFrame(0x421, b"\x01"),)
    assert codec.disable() == (CanFrame(0x421, b"\x00"),)


def test_only_a_hunter_has_a_brake_to_release():
    assert HUNTER.release_brake() == (CanFrame(0x131, b"\x00"),)
    assert SCOUT.release_brake() == codec_of("tracer").release_brake() == ()


@settings(deadline=None)
@given(linear=i16, angular=i16)
def test_motion_feedback_is_read_as_packed(linear, angular):
    reading = SCOUT.parse(frame(0x221, struct.pack(">hhhh", linear, angular, 7, 9)))
    assert reading.motion.vx == pytest.approx(linear / 1000)
    assert reading.motion.yaw_rate == pytest.approx(angular / 1000)


def test_a_hunter_turns_no_tighter_than_its_largest_central_angle():
    said, _ = HUNTER.command(Twist(vx=1.0, yaw_rate=10.0))
    assert said.yaw_rate == pytest.approx(math.tan(0.461) / 0.65, rel=0.02)  # AgileX rounds the inner 0.58


def test_a_hunters_motion_is_its_speed_and_what_its_inner_wheel_says_of_the_turn():
    reading = HUNTER.parse(frame(0x221, struct.pack(">hhhh", 1000, 0, 0, 384)))
    radius_m = 0.65 / 0.40403 + 0.605 / 2  # L / tan(0.384 rad) + half the front track
    assert reading.motion.yaw_rate == pytest.approx(1 / radius_m, rel=1e-3)


@settings(deadline=None)
@given(left=i32, right=i32)
def test_odometry_is_two_signed_millimetre_counters(left, right):
    reading = SCOUT.parse(frame(0x311, struct.pack(">ii", left, right)))
    assert reading.wheels_m == pytest.approx((left / 1000, right / 1000), abs=1e-6)


def test_the_counters_start_over_after_two_to_the_32_millimetres():
    assert SCOUT.wheel_wrap_m == pytest.approx(2**32 / 1000)


@settings(deadline=None)
@given(charge=st.integers(0, 100), volts=st.integers(0, 2**16 - 1))
def test_the_battery_tells_percent_and_tenths_of_a_volt(charge, volts):
    reading = SCOUT.parse(frame(0x361, struct.pack(">BBHhh", charge, 99, volts, -12, 251)))
    assert reading.battery == pytest.approx(charge / 100)
    assert reading.volts == pytest.approx(volts / 10)


def test_a_hunters_battery_counts_hundredths_of_a_volt():
    assert HUNTER.parse(frame(0x361, struct.pack(">BBHhh", 50, 99, 2520, 0, 0))).volts == pytest.approx(25.2)


@pytest.mark.parametrize(
    ("name", "value", "mode"),
    [
        ("scout", 0, "standby"),
        ("scout", 1, "ours"),
        ("scout", 3, "remote"),
        ("scout", 2, "unknown"),
        ("hunter", 2, "remote"),
        ("tracer", 0, "standby"),  # or its transmitter: see the profile
        ("tracer", 1, "ours"),
    ],
)
def test_each_model_tells_who_drives_by_its_own_values(name, value, mode):
    status = codec_of(name).parse(frame(0x211, struct.pack(">BBHHBB", 0, value, 261, 0, 0, 7))).status
    assert status.mode == mode
    assert (status.emergency_stop, status.fault, status.count) == (False, "", 7)
    assert status.volts == pytest.approx(26.1)


def state(vehicle=0, errors=0, name="scout"):
    return codec_of(name).parse(frame(0x211, struct.pack(">BBHHBB", vehicle, 1, 250, errors, 0, 0))).status


def test_an_emergency_stop_is_told_apart_from_a_fault():
    assert state(vehicle=1).emergency_stop
    assert state(vehicle=1).fault == ""


def test_a_fault_without_a_name_is_still_a_fault():
    assert state(vehicle=2).fault == "condition 2"
    assert state(errors=0x8000).fault == "error bit 15"


def test_faults_go_by_the_names_of_the_profile():
    assert state(errors=0b1001).fault == "battery under-voltage, motor 1 communication"
    assert state(errors=0x8000, name="tracer").fault == "bumper"


def test_a_low_battery_and_a_silent_transmitter_stop_nothing_and_are_told():
    assert state(errors=0b110).fault == ""
    assert state(errors=0b110).warning == "battery low, no transmitter heard (is it off?)"


@pytest.mark.parametrize("shift", [0, 8], ids=["as the SDK counts", "as the manual counts"])
@pytest.mark.parametrize("name", ["scout", "tracer"])
def test_both_readings_of_the_error_bits_stop_for_the_same_reason(name, shift):
    assert state(errors=0b001 << shift, name=name).fault == "battery under-voltage"
    off = state(errors=0b100 << shift, name=name)
    assert (off.fault, off.warning) == ("", "no transmitter heard (is it off?)")


def test_a_bit_of_which_the_manuals_disagree_stops_with_both_meanings():
    assert state(errors=1 << 9, name="scout").warning == "battery low"
    assert state(errors=1 << 9, name="tracer").fault == "external supply over-current or battery low"


def test_a_hunter_without_its_steering_encoder_is_not_driven():
    assert state(errors=1 << 9, name="hunter").fault == "steering encoder lost"
    off = state(errors=1 << 10 | 1 << 12, name="hunter")
    assert (off.fault, off.warning) == ("", "no transmitter heard (is it off?), nobody commands")


statuses = st.builds(
    BaseStatus,
    mode=st.sampled_from(["standby", "ours", "remote", "unknown"]),
    emergency_stop=st.booleans(),
    fault=st.sampled_from(["", "battery under-voltage"]),
    volts=st.integers(0, 2**16 - 1).map(lambda tenths: tenths / 10),
)


@pytest.mark.parametrize("codec", [SCOUT, HUNTER, codec_of("tracer")])
@settings(deadline=None)
@given(status=statuses, count=st.integers(0, 1000))
def test_what_the_simulator_says_of_its_condition_is_what_is_heard(codec, status, count):
    (sent,) = codec.status_frames(Reading(status=status), count)
    heard = codec.parse(sent).status
    assert (heard.mode, heard.emergency_stop, heard.fault) == (
        status.mode,
        status.emergency_stop,
        status.fault,
    )
    assert heard.volts == pytest.approx(status.volts)
    assert heard.count == count % 256


def test_the_simulator_wraps_its_counters_around():
    (_, odometry) = SCOUT.feedback_frames(Reading(motion=Twist(), wheels_m=(2147483.648, -1.0)))
    assert odometry == CanFrame(0x311, struct.pack(">ii", -(2**31), -1000))


def test_the_simulator_reads_each_request():
    assert HUNTER.parse_command(frame(0x421, [1])) == Demand(enable=True)
    assert HUNTER.parse_command(frame(0x421, [0])) == Demand(disable=True)
    assert HUNTER.parse_command(frame(0x131, [0])) == Demand(release_brake=True)


def test_a_request_with_another_value_asks_for_nothing():
    assert SCOUT.parse_command(frame(0x421, [2])) == Demand()


@pytest.mark.parametrize("data", [b"", b"\x00" * 7])
def test_a_short_frame_is_malformed(data):
    with pytest.raises(Malformed, match="bytes instead of 8"):
        SCOUT.parse(frame(0x221, data))


def test_an_oversized_frame_is_malformed():
    with pytest.raises(Malformed, match="8 bytes instead of 1"):
        Database("agilex_v2.dbc", "none").layout("ControlMode").decode(frame(0x421, bytes(8)))


def test_a_request_may_be_padded_as_agilexs_own_sdk_does_but_not_short():
    assert HUNTER.parse_command(frame(0x421, b"\x01" + bytes(7))) == Demand(enable=True)
    assert HUNTER.parse_command(frame(0x131, b"\x00" + b"\xff" * 7)) == Demand(release_brake=True)
    with pytest.raises(Malformed, match="0 bytes instead of 1"):
        HUNTER.parse_command(frame(0x421, b""))


def test_a_charge_above_all_is_malformed():
    with pytest.raises(Malformed, match="out of its range"):
        SCOUT.parse(frame(0x361, struct.pack(">BBHhh", 101, 0, 0, 0, 0)))


def test_each_side_ignores_its_own_direction_and_extended_twins():
    assert SCOUT.parse(frame(0x111, bytes(8))) is None
    assert SCOUT.parse_command(frame(0x221, bytes(8))) is None
    assert SCOUT.parse(CanFrame(0x221, bytes(8), extended=True)) is None


@pytest.mark.parametrize("motor", [1, 2, 3, 4])
def test_the_dbc_also_tells_of_each_motor(motor):
    dbc = cantools.database.load_file(find_dbc("agilex_v2.dbc"))
    assert dbc.decode_message(0x250 + motor, struct.pack(">hhi", -120, 35, -70_000)) == {
        "Speed": -120,
        "Current": pytest.approx(3.5),
        "Pulses": -70_000,
    }
    assert dbc.decode_message(0x260 + motor, struct.pack(">HhbBH", 261, -5, 40, 0x42, 0)) == {
        "DriverVoltage": pytest.approx(26.1),
        "DriverTemperature": -5,
        "MotorTemperature": 40,
        "DriverState": 0x42,
    }


def test_the_dbc_also_tells_how_errors_are_cleared_by_hand():
    message = cantools.database.load_file(find_dbc("agilex_v2.dbc")).get_message_by_name("ErrorClear")
    assert (message.frame_id, message.encode({"Code": 0})) == (0x441, b"\x00")


def test_the_dbc_also_tells_of_the_brake_and_the_batterys_health():
    dbc = cantools.database.load_file(find_dbc("agilex_v2.dbc"))
    assert dbc.decode_message(0x211, struct.pack(">BBHHBB", 0, 1, 250, 0, 1, 9))["Brake"] == 1
    battery = dbc.decode_message(0x361, struct.pack(">BBHhh", 80, 97, 2520, -31, 255))
    assert battery["StateOfHealth"] == 97
    assert (battery["Current"], battery["Temperature"]) == pytest.approx((-3.1, 25.5))
