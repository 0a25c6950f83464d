"""Every base's codec sends only finite commands, drops malformed frames and names mistakes."""

import itertools
import math
import random
import struct

import cantools
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from shipped_roles import BASES, codec_of, limits_of, roles_of

from adatracker_deploy.core.errors import PlatformError
from adatracker_deploy.core.messages import ZERO, Twist
from adatracker_wheeled.protocol.codec import FASTEST
from adatracker_wheeled.protocol.dbc import find_dbc
from adatracker_wheeled.protocol.frames import CanFrame, Malformed, Reading
from adatracker_wheeled.sim.fuzz import frames

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
    for hostile in itertools.islice(frames(ids, chance), 100_000):
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
