"""A profile's mistakes, each refused in one sentence that names the role, file, message and signal."""

import math
import struct
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from shipped_roles import codec_from, codec_of, limits_of, roles_as_written

from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.core.messages import Twist
from adatracker_wheeled.protocol.frames import BaseStatus, CanFrame, Malformed, Reading

MINE = """VERSION ""

BO_ 2566848512 Drive: 4 HOST
 SG_ Speed : 7|16@0- (0.001,0) [-2|2] "m/s" BASE
 SG_ Turn : 23|16@0- (0.001,0) [-2|2] "rad/s" BASE

BO_ 2566848513 Report: 6 BASE
 SG_ State : 7|8@0+ (1,0) [0|9] "" HOST
 SG_ Speed : 15|16@0- (0.001,0) [0|0] "m/s" HOST
 SG_ Turn : 31|16@0- (0.001,0) [0|0] "rad/s" HOST
 SG_ Charge : 47|8@0+ (1,0) [0|100] "%" HOST

BO_ 100 Offset: 2 HOST
 SG_ Speed : 7|8@0+ (1,10) [10|20] "m/s" BASE
 SG_ Turn : 15|8@0+ (1,10) [10|20] "rad/s" BASE
"""


def own_base():
    return {
        "dbc": "mine.dbc",
        "command": [{"message": "Drive", "signals": {"vx_m_s": "Speed", "yaw_rate_rad_s": "Turn"}}],
        "state": {"messages": ["Report"], "mode": "State", "ours": [2]},
        "feedback": [{"message": "Report", "signals": {"vx_m_s": "Speed", "yaw_rate_rad_s": "Turn"}}],
        "battery": [{"message": "Report", "signals": {"charge": {"signal": "Charge", "scale": 0.01}}}],
    }


def refused(written):
    with pytest.raises(UsageError) as caught:
        codec_from(written)
    text = str(caught.value)
    assert "\n" not in text
    return text


def test_a_dbc_that_is_not_there_is_named_with_where_it_was_sought(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    text = refused(roles_as_written() | {"dbc": "mine.dbc"})
    assert "mine.dbc: no such file" in text
    assert str(tmp_path) in text
    assert "agilex_v2.dbc" in text


def test_a_folder_is_no_dbc(tmp_path):
    assert "no such file" in refused(roles_as_written() | {"dbc": str(tmp_path)})


@settings(deadline=None)
@given(junk=st.binary(max_size=200))
def test_a_file_that_is_no_dbc_is_refused_whatever_is_in_it(tmp_path_factory, junk):
    path = tmp_path_factory.mktemp("junk") / "mine.dbc"
    path.write_bytes(junk)
    assert "mine.dbc" in refused(roles_as_written() | {"dbc": str(path)})


def test_a_dbc_beside_the_working_directory_is_found(tmp_path, monkeypatch):
    (tmp_path / "mine.dbc").write_text(MINE)
    monkeypatch.chdir(tmp_path)
    assert codec_from(own_base()).command(Twist(vx=1.0))[1][0].data == struct.pack(">hh", 1000, 0)


def test_a_missing_message_is_named_with_its_role_and_what_there_is():
    written = roles_as_written()
    written["enable"][0]["message"] = "ControlMood"
    text = refused(written)
    assert "enable: agilex_v2.dbc: has no message 'ControlMood'" in text
    assert "ControlMode" in text


def test_a_missing_signal_is_named_with_its_message():
    written = roles_as_written()
    written["command"][0]["signals"]["vx_m_s"] = "Speed"
    assert "command: agilex_v2.dbc: message MotionCommand has no signal 'Speed'" in refused(written)


def test_a_fixed_value_that_a_signal_never_has_is_refused():
    written = roles_as_written()
    written["enable"][0]["values"]["Mode"] = 256
    assert "ControlMode.Mode is never 256; it reaches from 0 to 255" in refused(written)


def test_a_state_value_that_a_signal_never_has_is_refused():
    written = roles_as_written()
    written["state"]["remote"] = [300]
    assert "SystemState.Mode is never 300" in refused(written)


def test_an_error_bit_that_is_not_there_is_refused():
    written = roles_as_written()
    written["state"]["faults"]["engine"] = 16
    assert "SystemState.Errors is never 65536" in refused(written)


def test_a_role_that_uses_anothers_message_is_still_the_one_that_is_named():
    written = roles_as_written("scout_v1")
    written["disable"][0]["values"] = {"Mood": 0}
    assert refused(written).startswith(
        "roles: disable: agilex_v1.dbc: message MotionCommand has no signal 'Mood'"
    )


def test_a_scale_of_zero_is_refused():
    written = roles_as_written()
    written["command"][0]["signals"]["vx_m_s"] = {"signal": "LinearVelocity", "scale": 0}
    assert "scale must not be 0" in refused(written)


def test_limits_that_a_signal_cannot_say_are_refused():
    with pytest.raises(UsageError, match=r"MotionCommand.Angular carries yaw_rate_rad_s from .* lower them"):
        codec_of("scout_v1").check_limits(replace(limits_of("scout_v1"), yaw_rate_rad_s=0.6))


def test_wheels_must_reach_speed_and_turn_together():
    assert 100 * math.tau * 0.085 > 53.3  # 100 turns/s would do for the speed alone
    with pytest.raises(UsageError, match=r"SetVelocity.Velocity carries (left|right)_m_s"):
        codec_of("odrive_diff").check_limits(replace(limits_of("odrive_diff"), forward_m_s=53.3))


@pytest.fixture
def own(tmp_path, monkeypatch):
    (tmp_path / "mine.dbc").write_text(MINE)
    monkeypatch.chdir(tmp_path)
    return own_base()


def test_one_29_bit_message_can_tell_everything(own):
    codec = codec_from(own)
    said = Reading(status=BaseStatus(mode="ours"), motion=Twist(vx=1.0, yaw_rate=-0.5), battery=0.5)
    frames = codec.status_frames(said)
    assert frames == codec.feedback_frames(said) == codec.battery_frames(said)
    assert frames == (
        CanFrame(2566848513 & 0x1FFFFFFF, struct.pack(">BhhB", 2, 1000, -500, 50), extended=True),
    )
    heard = codec.parse(frames[0])
    assert (heard.status.mode, heard.motion, heard.battery) == ("ours", said.motion, 0.5)


def test_a_charge_in_percent_that_was_not_scaled_is_malformed(own):
    said = codec_from(own).battery_frames(Reading(status=BaseStatus(mode="ours"), battery=0.5))
    own["battery"][0]["signals"]["charge"] = "Charge"
    with pytest.raises(Malformed, match="state of charge of 50"):
        codec_from(own).parse(said[0])


def test_a_base_without_words_for_a_fault_says_so(own):
    with pytest.raises(UsageError, match="names no signal that carries"):
        codec_from(own).status_frames(Reading(status=BaseStatus(mode="ours", emergency_stop=True)))
    with pytest.raises(UsageError, match="no mode value for remote"):
        codec_from(own).status_frames(Reading(status=BaseStatus(mode="remote")))


SCALE_0 = 'BO_ 101 Drive2: 1 HOST\n SG_ Speed : 7|8@0+ (0,0) [0|0] "" BASE'
SWITCHED = """BO_ 101 Drive2: 1 HOST
 SG_ Speed M : 7|4@0+ (1,0) [0|0] "" BASE
 SG_ Turn m0 : 3|4@0+ (1,0) [0|0] "" BASE"""


@pytest.mark.parametrize(
    ("line", "reason"),
    [(SCALE_0, "has a scale of 0"), (SWITCHED, "is multiplexed"), ("BO_ 101 Drive2: 0 HOST", "empty")],
)
def test_a_message_that_cannot_be_used_is_refused(own, line, reason):
    Path("mine.dbc").write_text(MINE + "\n" + line + "\n")
    own["enable"] = [{"message": "Drive2", "values": {"Speed": 0}}]
    assert reason in refused(own)


def test_two_messages_with_one_id_are_refused(own):
    Path("mine.dbc").write_text(MINE + '\nBO_ 100 Twin: 2 HOST\n SG_ Speed : 7|8@0+ (1,0) [0|0] "" BASE\n')
    own["enable"] = [{"message": "Twin", "values": {"Speed": 0}}]
    own["disable"] = [{"message": "Offset", "values": {"Speed": 12}}]
    assert "Twin and Offset have the same id 0x64" in refused(own)


def test_error_bits_must_be_unsigned(own):
    own["state"]["errors"] = "Speed"
    assert "state: mine.dbc: Report.Speed: error bits must be unsigned" in refused(own)


def test_a_file_that_is_too_large_is_not_read(own):
    Path("mine.dbc").write_bytes(bytes((4 << 20) + 1))
    assert "larger than 4 MiB" in refused(own)


def test_a_command_that_cannot_say_zero_is_refused(own):
    own["command"][0]["message"] = "Offset"
    assert "Offset.Speed cannot carry zero" in refused(own)
