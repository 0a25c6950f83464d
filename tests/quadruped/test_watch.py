"""What counts as news from a robot."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from adatracker_deploy.geometry import Pose
from adatracker_deploy.platform import ZERO
from adatracker_quadruped.messages import Malformed, Odometry, decode_odometry, encode_odometry
from adatracker_quadruped.watch import fresh


def said(stamp_ns):
    return encode_odometry(Odometry(Pose(), ZERO, stamp_ns))


@given(st.lists(st.integers(0, 5), max_size=20))
def test_a_stamp_that_comes_twice_in_a_row_is_no_news_unless_it_is_none_at_all(stamps):
    hear = fresh(decode_odometry)
    before = 0
    for stamp_ns in stamps:
        if stamp_ns == before != 0:
            with pytest.raises(Malformed):
                hear(said(stamp_ns))
        else:
            assert hear(said(stamp_ns)).stamp_ns == stamp_ns
        before = stamp_ns


def test_rubbish_between_two_messages_changes_nothing():
    hear = fresh(decode_odometry)
    assert hear(said(1)).stamp_ns == 1
    with pytest.raises(Malformed):
        hear(b"rubbish")
    with pytest.raises(Malformed):
        hear(said(1))
