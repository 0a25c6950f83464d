"""What counts as news from a robot."""

import itertools
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from adatracker_deploy.core.clock import FakeClock
from adatracker_deploy.core.geometry import Pose
from adatracker_deploy.core.messages import ZERO
from adatracker_quadruped.adapter.monitor import Fresh
from adatracker_quadruped.protocol.messages import Malformed, Odometry, decode_odometry, encode_odometry


def said(stamp_ns):
    return encode_odometry(Odometry(Pose(), ZERO, stamp_ns))


def taken(hear, stamps):
    """Return the stamps of those messages that count as new."""
    new = []
    for stamp_ns in stamps:
        try:
            new.append(hear(said(stamp_ns)).stamp_ns)
        except Malformed:
            continue
    return new


@pytest.fixture
def clock():
    return FakeClock()


def test_two_stamps_in_turn_are_news_once(clock):
    hear = Fresh(decode_odometry, clock)
    assert taken(hear, [5, 4, 5, 4]) == [5]
    assert hear.restarted_s() == math.inf


def test_a_driver_that_begins_again_is_told_and_then_heard(clock):
    hear = Fresh(decode_odometry, clock)
    assert taken(hear, [100, 101, 1, 2, 3]) == [100, 101]
    assert hear.restarted_s() == 0.0
    clock.advance(0.5)
    assert taken(hear, [4, 5]) == [4, 5]
    assert hear.restarted_s() == 0.5


def test_a_sender_that_gives_no_stamps_is_always_heard(clock):
    assert taken(Fresh(decode_odometry, clock), [0, 0, 0]) == [0, 0, 0]


@given(st.lists(st.integers(0, 5), max_size=20))
def test_what_is_heard_is_newer_than_before_or_the_restart_is_known(stamps):
    clock = FakeClock()
    hear = Fresh(decode_odometry, clock)
    new = taken(hear, stamps)
    in_order = all(a < b or a == b == 0 for a, b in itertools.pairwise(new))
    assert in_order or hear.restarted_s() == 0.0


def test_rubbish_between_two_messages_changes_nothing(clock):
    hear = Fresh(decode_odometry, clock)
    assert hear(said(1)).stamp_ns == 1
    with pytest.raises(Malformed):
        hear(b"rubbish")
    with pytest.raises(Malformed):
        hear(said(1))
