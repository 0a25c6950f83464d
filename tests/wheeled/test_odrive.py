"""Two ODrive axes: little-endian floats, one message a wheel."""

import math
import re
import struct

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from shipped_roles import codec_of, frame

from adatracker_deploy.core.messages import Twist
from adatracker_deploy.registry import load_profile, profile_dir
from adatracker_wheeled.platform import WheeledPlatform
from adatracker_wheeled.protocol.frames import CanFrame, Malformed, Reading

TURN_M = 2 * math.pi * 0.085
speeds = st.floats(-1.5, 1.5)
nan_bytes = struct.pack("<ff", math.nan, 0.0)


def command_id(node, command):
    return node << 5 | command


def encoder(node, position_turns, velocity_turns_s):
    return frame(command_id(node, 0x09), struct.pack("<ff", position_turns, velocity_turns_s))


def heartbeat(node, error=0, state=8):
    return frame(command_id(node, 0x01), struct.pack("<IBBBB", error, state, 0, 0, 0))


def test_a_command_is_a_float_in_turns_for_each_wheel_the_right_one_mirrored():
    _, frames = codec_of("odrive_diff").command(Twist(vx=0.5, yaw_rate=1.0))
    left, right = (0.5 - 0.2) / TURN_M, (0.5 + 0.2) / TURN_M
    assert frames == (
        CanFrame(command_id(0, 0x0D), struct.pack("<ff", left, 0.0)),
        CanFrame(command_id(1, 0x0D), struct.pack("<ff", -right, 0.0)),
    )


def test_both_axes_are_put_into_velocity_control_and_then_closed_loop():
    assert codec_of("odrive_diff").enable() == (
        CanFrame(command_id(0, 0x0B), struct.pack("<II", 2, 1)),
        CanFrame(command_id(1, 0x0B), struct.pack("<II", 2, 1)),
        CanFrame(command_id(0, 0x07), struct.pack("<I", 8)),
        CanFrame(command_id(1, 0x07), struct.pack("<I", 8)),
    )


def test_both_axes_are_idled():
    assert codec_of("odrive_diff").disable() == tuple(
        CanFrame(command_id(n, 0x07), struct.pack("<I", 1)) for n in (0, 1)
    )


def test_motion_is_told_when_both_wheels_have_spoken():
    codec = codec_of("odrive_diff")
    assert codec.parse(encoder(0, 1.0, 2.0)) == Reading()
    reading = codec.parse(encoder(1, -3.0, -2.0))
    assert reading.motion.vx == pytest.approx(2.0 * TURN_M)
    assert reading.motion.yaw_rate == pytest.approx(0.0)
    assert reading.wheels_m == pytest.approx((1.0 * TURN_M, 3.0 * TURN_M))


def test_one_wheel_alone_never_tells_a_motion():
    codec = codec_of("odrive_diff")
    codec.parse(encoder(0, 0.0, 1.0))
    codec.parse(encoder(1, 0.0, -1.0))
    assert all(codec.parse(encoder(0, 0.0, 1.0)).motion is None for _ in range(50))


def test_the_base_is_what_the_worse_axis_says():
    codec = codec_of("odrive_diff")
    codec.parse(heartbeat(0))
    assert codec.parse(heartbeat(1)).status.mode == "ours"
    codec.parse(heartbeat(0))
    status = codec.parse(heartbeat(1, error=1 << 24 | 1 << 9, state=1)).status
    assert status.mode == "standby"
    assert status.fault == "under-voltage, watchdog"


@settings(deadline=None)
@given(vx=speeds, yaw_rate=speeds)
def test_the_simulator_hears_the_velocity_that_was_really_sent(vx, yaw_rate):
    codec = codec_of("odrive_diff")
    said, (left, right) = codec.command(Twist(vx=vx, yaw_rate=yaw_rate))
    assert codec.parse_command(left).twist is None
    assert codec.parse_command(right).twist == said
    assert said.vx == pytest.approx(vx, abs=1e-6)
    assert said.yaw_rate == pytest.approx(yaw_rate, abs=1e-6)


def test_the_simulator_is_enabled_when_each_axis_is():
    codec = codec_of("odrive_diff")
    asked = [codec.parse_command(sent).enable for sent in codec.enable()]
    assert asked == [False, False, False, True]


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_a_measured_speed_that_is_no_number_is_malformed(value):
    with pytest.raises(Malformed, match="out of its range"):
        codec_of("odrive_diff").parse(encoder(0, 0.0, value))


def test_a_position_that_is_no_number_is_malformed():
    with pytest.raises(Malformed, match="out of its range"):
        codec_of("odrive_diff").parse(frame(command_id(1, 0x09), nan_bytes))


def test_float_positions_do_not_wrap():
    assert codec_of("odrive_diff").wheel_wrap_m is None


def test_position_and_speed_travel_in_one_message():
    codec = codec_of("odrive_diff")
    frames = codec.feedback_frames(Reading(motion=Twist(vx=0.4), wheels_m=(1.0, 2.0)))
    assert len(frames) == 2
    heard = [codec.parse(sent) for sent in frames][-1]
    assert heard.motion.vx == pytest.approx(0.4)
    assert heard.wheels_m == pytest.approx((1.0, 2.0))


def test_whoever_sets_the_axes_up_is_told_the_baud_rate_that_the_profile_opens_the_bus_with():
    """ODrive's own default is 250000, at which a bus of 500000 hears nothing but errors."""
    text = (profile_dir() / "odrive_diff.yaml").read_text(encoding="utf-8")
    bitrate = load_profile("odrive_diff", WheeledPlatform).connection.bitrate
    told = re.findall(r"can\.config\.baud_rate (\d+)|type can bitrate (\d+)", text)
    assert told == [(str(bitrate), ""), ("", str(bitrate))]
