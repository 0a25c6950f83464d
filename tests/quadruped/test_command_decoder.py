"""A robot takes commands in order, in time, and only of the kind it was told to expect."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from adatracker_deploy.core.messages import ZERO, Twist
from adatracker_quadruped.protocol import sport
from adatracker_quadruped.protocol.command_decoder import STALE_S, CommandDecoder
from adatracker_quadruped.protocol.connection import Connection
from adatracker_quadruped.protocol.keys import attachment
from adatracker_quadruped.protocol.messages import encode_twist, encode_twist_stamped

WALK = Twist(vx=0.5, vy=-0.1, yaw_rate=0.3)
NOW_NS = 1_700_000_000_000_000_000


def decoder(**connection):
    return CommandDecoder(Connection(**connection))


@pytest.mark.parametrize(
    ("command", "payload"),
    [
        ("twist", encode_twist(WALK)),
        ("twist_stamped", encode_twist_stamped(WALK, NOW_NS, "base_link")),
        ("unitree_sport", sport.encode_move(WALK, request_id=1)),
    ],
)
def test_each_kind_of_command_is_understood_and_no_other(command, payload):
    assert decoder(command=command).take(payload, None, NOW_NS) == WALK
    for other in {"twist", "twist_stamped", "unitree_sport"} - {command}:
        deaf = decoder(command=other)
        assert deaf.take(payload, None, NOW_NS) is None
        assert deaf.dropped == 1


def test_stop_move_is_a_zero_and_other_requests_are_dropped():
    stand_down = sport._encode(1005, "", 2)
    robot = decoder(command="unitree_sport")
    assert robot.take(sport.encode_stop(request_id=1), None, NOW_NS) == ZERO
    assert robot.take(stand_down, None, NOW_NS) is None


@given(st.floats(0, 10))
def test_a_stamped_command_is_taken_until_it_is_stale(age_s):
    payload = encode_twist_stamped(WALK, NOW_NS - round(age_s * 1e9), "base_link")
    taken = decoder(command="twist_stamped").take(payload, None, NOW_NS)
    assert taken == (WALK if round(age_s * 1e9) <= STALE_S * 1e9 else None)


def test_what_comes_again_or_out_of_order_from_one_sender_is_dropped():
    robot = decoder(dialect="rmw_zenoh")
    one, other = bytes(16), bytes(range(16))

    def took(sequence, sender):
        return robot.take(encode_twist(WALK), attachment(sequence, NOW_NS, sender), NOW_NS) is not None

    assert [took(n, one) for n in (1, 3, 2, 3, 4)] == [True, True, False, False, True]
    assert took(1, other)
    assert robot.dropped == 2


def test_without_the_attachment_of_its_dialect_nothing_is_taken():
    robot = decoder(dialect="rmw_zenoh")
    for attached in (None, b"", bytes(10)):
        assert robot.take(encode_twist(WALK), attached, NOW_NS) is None


@given(st.binary(max_size=200), st.none() | st.binary(max_size=40))
def test_whatever_comes_is_dropped_or_finite(payload, attached):
    for command in ("twist", "twist_stamped", "unitree_sport"):
        for dialect in ("ros2dds", "rmw_zenoh"):
            twist = decoder(command=command, dialect=dialect).take(payload, attached, NOW_NS)
            assert twist is None or all(map(math.isfinite, (twist.vx, twist.vy, twist.yaw_rate)))
