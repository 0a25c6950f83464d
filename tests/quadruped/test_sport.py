"""Unitree's sport requests, against CDR written by hand."""

import json
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from adatracker_deploy.core.errors import PlatformError
from adatracker_deploy.core.messages import Twist
from adatracker_quadruped.protocol import ros_types as parts
from adatracker_quadruped.protocol import sport
from adatracker_quadruped.protocol.messages import Malformed
from tests.quadruped import cdr

LAYOUT = cdr.LAYOUTS["Request"]
speeds = st.floats(-parts.FASTEST, parts.FASTEST)
ids = st.integers(-(2**63), 2**63 - 1)


def request(parameter="", api_id=sport.MOVE, order="<", padding=0):
    return cdr.encode(LAYOUT, [7, api_id, 0, 0, True, parameter, b""], order, padding)


@given(speeds, speeds, speeds, ids)
def test_a_move_is_api_1008_with_x_forward_y_left_z_counter_clockwise(vx, vy, yaw_rate, request_id):
    payload = sport.encode_move(Twist(vx=vx, vy=vy, yaw_rate=yaw_rate), request_id)
    *numbers, parameter, binary = cdr.decode(LAYOUT, payload)
    assert numbers == [request_id, 1008, 0, 0, True]
    assert (json.loads(parameter), binary) == ({"x": vx, "y": vy, "z": yaw_rate}, b"")
    assert sport.decode_request(payload) == sport.SportRequest(
        request_id, sport.MOVE, Twist(vx=vx, vy=vy, yaw_rate=yaw_rate)
    )


def test_a_stop_is_api_1003_and_nothing_else():
    payload = sport.encode_stop(9)
    assert cdr.decode(LAYOUT, payload) == [9, 1003, 0, 0, True, "", b""]
    assert sport.decode_request(payload) == sport.SportRequest(9, sport.STOP_MOVE)


@given(st.sampled_from("<>"), st.integers(0, 255))
def test_a_request_is_read_in_either_byte_order_whatever_pads_it(order, padding):
    payload = request('{"x": 1, "y": 0.5, "z": -2e-1, "more": []}', order=order, padding=padding)
    assert sport.decode_request(payload).twist == Twist(vx=1.0, vy=0.5, yaw_rate=-0.2)


def test_a_request_for_anything_else_moves_nothing():
    assert sport.decode_request(request('{"x": 1, "y": 0, "z": 0}', api_id=1016)).twist is None


@pytest.mark.parametrize("axis", ["vx", "vy", "yaw_rate"])
@pytest.mark.parametrize("value", [math.nan, math.inf, -1e300])
def test_what_is_no_velocity_never_becomes_a_request(axis, value):
    with pytest.raises(PlatformError, match="not a velocity"):
        sport.encode_move(Twist(**{axis: value}), 1)


@pytest.mark.parametrize(
    "parameter",
    [
        "",
        "{",
        "null",
        "[1, 2, 3]",
        '"xyz"',
        '{"x": 1, "y": 0}',
        '{"x": NaN, "y": 0, "z": 0}',
        '{"x": 1e999, "y": 0, "z": 0}',
        '{"x": 101, "y": 0, "z": 0}',
        '{"x": true, "y": 0, "z": 0}',
        '{"x": "1", "y": 0, "z": 0}',
        '{"x": {"x": 1}, "y": 0, "z": 0}',
        '{"x": 1' + "0" * 400 + ', "y": 0, "z": 0}',
        '{"x": 1' + "0" * 3900 + ', "y": 0, "z": 0}',
        "[" * 3900,
    ],
)
def test_a_move_without_a_velocity_is_malformed(parameter):
    with pytest.raises(Malformed):
        sport.decode_request(request(parameter))
