"""What holds for every base: nothing unreal is sent, nothing malformed is believed, mistakes are named."""

import math
import random
import struct
from dataclasses import replace

import cantools
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from shipped_roles import BASES, codec_from, codec_of, frame, limits_of, roles_as_written, roles_of

from adatracker_deploy.errors import PlatformError, UsageError
from adatracker_deploy.platform import ZERO, Twist
from adatracker_wheeled.codec import FASTEST
from adatracker_wheeled.layout import find_dbc
from adatracker_wheeled.protocol import BaseStatus, CanFrame, Malformed, Reading

CODECS = {name: codec_of(name) for name in BASES}
ROLES = {name: roles_of(name) for name in BASES}
LIMITS = {name: limits_of(name) for name in BASES}
anything = st.floats(-FASTEST, FASTEST)
every_base = pytest.mark.parametrize("name", BASES)


def heard_by_the_base(codec, frames):
    return [codec.parse_command(sent) for sent in frames][-1].twist


@every_base
@settings(deadline=None)
@given(vx=anything, vy=anything, yaw_rate=anything)
def test_what_is_said_to_be_sent_is_what_the_base_hears(name, vx, vy, yaw_rate):
    codec = CODECS[name]
    said, frames = codec.command(Twist(vx=vx, vy=vy, yaw_rate=yaw_rate))
    assert heard_by_the_base(codec, frames) == said


@every_base
@settings(deadline=None)
@given(data=st.data())
def test_within_the_limits_a_command_is_changed_by_rounding_alone(name, data):
    limits = LIMITS[name]
    vx = data.draw(st.floats(-limits.backward_m_s, limits.forward_m_s))
    yaw_rate = data.draw(st.floats(-limits.yaw_rate_rad_s, limits.yaw_rate_rad_s))
    said, _ = CODECS[name].command(Twist(vx=vx, yaw_rate=yaw_rate))
    assert said.vx == pytest.approx(vx, abs=0.0076)  # half of v1's percent of 1.5 m/s is the coarsest
    if ROLES[name].drive != "ackermann":
        assert said.yaw_rate == pytest.approx(yaw_rate, abs=0.003)
    else:
        assert abs(said.yaw_rate) <= abs(yaw_rate) + 0.01  # a steering angle can only make a turn wider


@every_base
def test_zero_is_exactly_zero(name):
    assert CODECS[name].command(ZERO)[0] == ZERO


@every_base
@settings(deadline=None)
@given(
    axis=st.sampled_from(["vx", "vy", "vz", "yaw_rate"]),
    value=st.sampled_from([math.nan, math.inf, -math.inf, 1e300, FASTEST * 1.01]),
)
def test_what_is_no_velocity_is_never_encoded(name, axis, value):
    with pytest.raises(PlatformError, match="not a velocity"):
        CODECS[name].command(Twist(**{axis: value}))


@every_base
def test_beyond_a_signals_range_it_says_its_most(name):
    said, _ = CODECS[name].command(Twist(vx=FASTEST))
    assert 0 < said.vx <= FASTEST


def test_rounding_is_to_the_nearest_step_not_towards_zero():
    said, frames = CODECS["scout"].command(Twist(vx=0.9996, yaw_rate=-0.9996))
    assert frames[0].data[:4] == struct.pack(">hh", 1000, -1000)
    assert (said.vx, said.yaw_rate) == (1.0, -1.0)


@every_base
@settings(deadline=None)
@given(vx=st.floats(-1.2, 1.2), yaw_rate=st.floats(-0.5, 0.5), rolled=st.floats(-1e6, 1e6))
def test_what_the_base_measures_is_what_is_heard(name, vx, yaw_rate, rolled):
    codec = CODECS[name]
    sent = codec.feedback_frames(Reading(motion=Twist(vx=vx, yaw_rate=yaw_rate), wheels_m=(rolled, -rolled)))
    readings = [codec.parse(each) for each in sent]
    motion = next(reading.motion for reading in readings if reading.motion)
    assert motion.vx == pytest.approx(vx, abs=0.001)
    if ROLES[name].drive != "ackermann":
        assert motion.yaw_rate == pytest.approx(yaw_rate, abs=0.001)
    if ROLES[name].odometry:
        wheels = next(reading.wheels_m for reading in readings if reading.wheels_m)
        assert wheels == pytest.approx((rolled, -rolled), abs=0.001, rel=1e-6)


@every_base
def test_a_hundred_thousand_hostile_frames_are_dropped_or_read_and_nothing_else(name):
    codec, chance = codec_of(name), random.Random(7)
    ids = [message.frame_id for message in cantools.database.load_file(find_dbc(roles_of(name).dbc)).messages]
    outcomes = {"read": 0, "malformed": 0, "unknown": 0}
    for _ in range(100_000):
        can_id = chance.choice(ids) if chance.random() < 0.9 else chance.randrange(1 << 11)
        hostile = frame(can_id, chance.randbytes(chance.choice((0, 1, 2, 4, 7, 8, 8, 8))))
        for hear in (codec.parse, codec.parse_command):
            try:
                outcomes["unknown" if hear(hostile) is None else "read"] += 1
            except Malformed:
                outcomes["malformed"] += 1
    assert all(outcomes.values())


@every_base
@settings(deadline=None)
@given(can_id=st.integers(0, 2**11 - 1), data=st.binary(max_size=8))
def test_whatever_is_read_is_finite(name, can_id, data):
    try:
        reading = CODECS[name].parse(CanFrame(can_id, data))
    except Malformed:
        return
    if reading is not None and reading.motion is not None:
        assert reading.motion.is_finite()
    if reading is not None and reading.wheels_m is not None:
        assert all(map(math.isfinite, reading.wheels_m))


@every_base
def test_every_shipped_profiles_limits_can_be_said(name):
    CODECS[name].check_limits(LIMITS[name])


@pytest.mark.parametrize("value", [(0x800, False), (1 << 29, True), (-1, False)])
def test_a_frames_id_must_fit_its_bits(value):
    with pytest.raises(ValueError, match="does not fit"):
        CanFrame(value[0], b"", value[1])


def test_a_frame_has_at_most_eight_bytes():
    with pytest.raises(ValueError, match="at most 8 bytes"):
        CanFrame(1, bytes(9))


# ---- mistakes of a profile, each in one sentence


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


def test_a_scale_of_zero_is_refused():
    written = roles_as_written()
    written["command"][0]["signals"]["vx_m_s"] = {"signal": "LinearVelocity", "scale": 0}
    assert "scale must not be 0" in refused(written)


def test_limits_that_a_signal_cannot_say_are_refused():
    with pytest.raises(UsageError, match=r"MotionCommand.Angular says yaw_rate_rad_s from .* lower them"):
        CODECS["scout_v1"].check_limits(replace(limits_of("scout_v1"), yaw_rate_rad_s=0.6))


def test_wheels_must_reach_speed_and_turn_together():
    assert 100 * 2 * math.pi * 0.085 > 53.3  # 100 turns/s would do for the speed alone
    with pytest.raises(UsageError, match=r"SetVelocity.Velocity says (left|right)_m_s"):
        CODECS["odrive_diff"].check_limits(replace(limits_of("odrive_diff"), forward_m_s=53.3))


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


def test_a_base_without_words_for_a_fault_says_so(own):
    with pytest.raises(UsageError, match="names no signal that can tell"):
        codec_from(own).status_frames(Reading(status=BaseStatus(mode="ours", emergency_stop=True)))
    with pytest.raises(UsageError, match="no mode value for remote"):
        codec_from(own).status_frames(Reading(status=BaseStatus(mode="remote")))


def test_a_command_that_cannot_say_zero_is_refused(own):
    own["command"][0]["message"] = "Offset"
    assert "Offset.Speed cannot say zero" in refused(own)
