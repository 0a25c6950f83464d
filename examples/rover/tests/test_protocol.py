"""Every datagram means one thing, and what is no datagram means nothing."""

import math

import pytest
from adatracker_deploy import Pose, Twist
from hypothesis import given
from hypothesis import strategies as st

from adatracker_rover.protocol.messages import (
    Ask,
    Mode,
    Report,
    Request,
    decode_report,
    decode_request,
    encode_report,
    encode_request,
    quantise,
)

VELOCITIES = st.builds(
    Twist,
    vx=st.floats(allow_nan=False, allow_infinity=False),
    yaw_rate=st.floats(allow_nan=False, allow_infinity=False),
)


def test_the_bytes_are_those_of_the_manual():
    request = Request(Ask.DRIVE, Twist(vx=0.5, yaw_rate=-0.2))
    assert encode_request(request).hex(" ") == "52 51 02 00 f4 01 38 ff"
    report = Report(Mode.DRIVE, 0.9, 0.5, Pose(x=1.0, y=-2.0, yaw=0.1), Twist(vx=0.5, yaw_rate=-0.2))
    told = "52 50 01 5a f4 01 e8 03 00 00 30 f8 ff ff 64 00 f4 01 38 ff"
    assert encode_report(report).hex(" ") == told
    assert decode_report(bytes.fromhex(told)) == report


@given(ask=st.sampled_from(Ask), velocity=VELOCITIES)
def test_a_request_arrives_as_it_was_sent(ask, velocity):
    assert decode_request(encode_request(Request(ask, velocity))) == Request(ask, quantise(velocity))


@given(velocity=VELOCITIES)
def test_the_wire_says_thousandths_and_never_more_than_was_asked_for(velocity):
    said = quantise(velocity)
    assert quantise(said) == said
    for value, asked in ((said.vx, velocity.vx), (said.yaw_rate, velocity.yaw_rate)):
        assert abs(value) <= 32.767
        assert abs(value - asked) <= 0.0005 + 1e-9 or abs(asked) > 32.767


@given(data=st.binary(max_size=64))
def test_whatever_comes_in_is_a_report_in_its_ranges_or_nothing(data):
    for datagram in (data, b"RP" + data, (b"RP" + data).ljust(20, b"\0")[:20]):
        report = decode_report(datagram)
        if report is not None:
            assert 0 <= report.battery <= 1
            assert math.isfinite(report.pose.x + report.pose.y + report.pose.yaw)
            assert decode_report(encode_report(report)) == report


@pytest.mark.parametrize(
    "data", [b"", b"RQ", b"RQ\x09\0\0\0\0\0", b"XX\x02\0\0\0\0\0", b"RQ\x02\0\0\0\0\0\0"]
)
def test_what_is_no_request_is_none(data):
    assert decode_request(data) is None
