"""The quadruped's monitor tells new messages from repeated, late and foreign ones."""

import itertools
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from adatracker_deploy.core.clock import FakeClock
from adatracker_deploy.core.geometry import Pose
from adatracker_deploy.core.messages import ZERO
from adatracker_deploy.core.stamps import Fresh, NotNew
from adatracker_deploy.perception.zenoh_graph import Graph
from adatracker_quadruped.adapter.monitor import RobotMonitor
from adatracker_quadruped.protocol.connection import Connection
from adatracker_quadruped.protocol.keys import Keys
from adatracker_quadruped.protocol.messages import Malformed, Odometry, decode_odometry, encode_odometry
from adatracker_quadruped.protocol.session import open_session
from tests.quadruped.routers import free_port, robot, until


def said(stamp_ns):
    return encode_odometry(Odometry(Pose(), ZERO, stamp_ns))


def taken(hear, stamps):
    """Return the stamps of those messages that count as new."""
    new = []
    for stamp_ns in stamps:
        try:
            new.append(hear(said(stamp_ns)).stamp_ns)
        except NotNew:
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
    with pytest.raises(NotNew):
        hear(said(1))


def test_the_tokens_by_which_ros_2_counts_us_do_not_pass_for_the_robots():
    """`@ros2_lv/0/**` is every ROS 2 entity under rmw_zenoh, our own among them."""
    on = Connection(
        endpoint=f"tcp/127.0.0.1:{free_port()}", dialect="rmw_zenoh", robot_liveliness="@ros2_lv/0/**"
    )
    with robot(on) as there, open_session(on) as here:
        graph = Graph(here)
        for key in (Keys(on).odometry, Keys(on).imu):
            graph.subscribes(key)
        monitor = RobotMonitor(here, on, FakeClock())
        until(lambda: len(list(there.liveliness().get("@ros2_lv/0/**", timeout=1.0))) > 1)
        assert "the robot is gone: no liveliness token" in monitor.trouble()
        node = there.liveliness().declare_token("@ros2_lv/0/abc/0/0/NN/%/%/base_driver")
        until(lambda: "the robot is gone" not in monitor.trouble())
        node.undeclare()
        until(lambda: "the robot is gone" in monitor.trouble())
    monitor.join()
