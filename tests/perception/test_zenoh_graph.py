"""ROS 2 nodes under rmw_zenoh count this program's publishers and subscribers as they count each other's."""

from __future__ import annotations

import contextlib
import threading
import time

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

zenoh = pytest.importorskip("zenoh", reason="needs the extra 'zenoh'")

from adatracker_deploy.core.clock import MonotonicClock  # noqa: E402 - after the skip
from adatracker_deploy.perception.sources import open_source  # noqa: E402
from adatracker_deploy.perception.zenoh_graph import (  # noqa: E402
    NODE,
    Graph,
    Topic,
    is_ours,
    node_token,
    publisher_token,
    subscriber_token,
    topic_of,
)
from adatracker_deploy.perception.zenoh_session import session_config  # noqa: E402
from tests.perception.test_zenoh_camera import free_port, message, until  # noqa: E402

HASH = "RIHS01_" + "15640771531571185e2efc8a100baf923961a4d15d5569652e6cb6691e8e371a"
TYPE = "sensor_msgs::msg::dds_::CompressedImage_"
IMAGES = Topic(7, "front/camera/compressed", TYPE, HASH)
KEY = f"7/front/camera/compressed/{TYPE}/{HASH}"
ZID = "e0fde13ac6ad53d13da469120d36e426"
CLOCK = MonotonicClock()
NAMES = st.from_regex(r"[A-Za-z_][A-Za-z0-9_]{0,9}(/[A-Za-z_][A-Za-z0-9_]{0,9}){0,4}", fullmatch=True)


def entity(token):
    """Parse a token as ros2/rmw_zenoh's `Entity::make` does (liveliness_utils.cpp, 0.2 to 0.10)."""
    parts = token.split("/")
    assert len(parts) in (9, 13)
    assert all(parts)
    admin, domain, zid, nid, number, kind, enclave, namespace, node, *topic = parts
    assert (admin, zid, enclave, namespace) == ("@ros2_lv", ZID, "%", "%")  # % stands for a slash
    assert kind in ("NN", "MP", "MS")
    assert (kind == "NN") == (not topic)
    if not topic:
        return kind, int(domain), nid, number, node
    name, type_, type_hash, qos = topic
    reliability, durability, history, deadline, lifespan, lease = qos.split(":")
    assert (reliability, durability) == ("2", "2")  # best effort, volatile
    assert history == "1,1"  # keep last, one
    assert [deadline, lifespan, lease] == [",", ",", ",,"]  # none
    return kind, int(domain), nid, number, node, name.replace("%", "/"), type_, type_hash


def test_the_tokens_are_rmw_zenohs_byte_by_byte():
    assert node_token(7, ZID) == f"@ros2_lv/7/{ZID}/0/0/NN/%/%/adatracker_deploy"
    assert subscriber_token(IMAGES, ZID, 1) == (
        f"@ros2_lv/7/{ZID}/0/1/MS/%/%/adatracker_deploy/%front%camera%compressed/{TYPE}/{HASH}/2:2:1,1:,:,:,,"
    )
    assert publisher_token(IMAGES, ZID, 2) == (
        f"@ros2_lv/7/{ZID}/0/2/MP/%/%/adatracker_deploy/%front%camera%compressed/{TYPE}/{HASH}/2:2:1,1:,:,:,,"
    )


@given(NAMES, st.integers(0, 232), st.integers(1, 99), st.sampled_from([HASH, "TypeHashNotSupported"]))
def test_whatever_the_topic_rmw_zenoh_reads_it_in_the_token(name, domain, number, type_hash):
    topic = topic_of(f"{domain}/{name}/{TYPE}/{type_hash}")
    assert topic == Topic(domain, name, TYPE, type_hash)
    for kind, token in (
        ("MS", subscriber_token(topic, ZID, number)),
        ("MP", publisher_token(topic, ZID, number)),
    ):
        assert entity(token) == (kind, domain, "0", str(number), NODE, f"/{name}", TYPE, type_hash)
        assert is_ours(token)
        zenoh.KeyExpr(token)  # it is a key
    assert entity(node_token(domain, ZID)) == ("NN", domain, "0", "0", NODE)


@pytest.mark.parametrize(
    "key", ["", "camera/compressed", "rt/camera", f"camera/{TYPE}/{HASH}", f"7/camera/{TYPE}/RIHS01_0"]
)
def test_a_key_of_another_dialect_is_shown_to_nobody(key):
    assert topic_of(key) is None


@pytest.mark.parametrize(
    "token", [f"@ros2_lv/0/{ZID}/0/0/NN/%/%/talker", "@/abc/@ros2_lv/MP/x", "adatracker/host", ""]
)
def test_a_robots_token_is_not_ours(token):
    assert not is_ours(token)


class ImageTransport:
    """A robot's camera that encodes pictures only while it counts a subscriber, as image_transport does."""

    def __init__(self, port):
        self.session = zenoh.open(session_config(f"tcp/127.0.0.1:{port}", mode="router"))
        self._publisher = self.session.declare_publisher(
            KEY, congestion_control=zenoh.CongestionControl.BLOCK
        )
        self._tokens = self.session.liveliness().declare_subscriber(
            "@ros2_lv/7/**", zenoh.handlers.FifoChannel(64), history=True
        )
        self.counted, self.shots = set(), 0

    def shoot(self):
        while (change := self._tokens.try_recv()) is not None:
            token = str(change.key_expr)
            if "/MS/" in token and "/%front%camera%compressed/" in token:
                (self.counted.add if change.kind == zenoh.SampleKind.PUT else self.counted.discard)(token)
        if self.counted:
            self.shots += 1
            picture = cv2.imencode(".png", np.full((24, 32, 3), self.shots % 256, np.uint8))[1].tobytes()
            self._publisher.put(message(picture, stamp_ns=time.time_ns()))


def test_a_camera_that_publishes_only_to_who_is_counted_is_seen_and_then_rests():
    port = free_port()
    robot = ImageTransport(port)
    with contextlib.closing(robot.session):
        robot.shoot()
        assert not robot.shots
        camera = open_source(f"zenoh://127.0.0.1:{port}/{KEY}", CLOCK)
        with contextlib.closing(camera):
            opening = threading.Thread(target=camera.open)
            opening.start()
            until(lambda: robot.shoot() or not opening.is_alive())
            assert len(robot.counted) == 1
            assert camera.read(CLOCK.now_ns()).rgb.shape == (24, 32, 3)
        until(lambda: robot.shoot() or not robot.counted)


def test_a_session_is_one_node_with_a_number_for_each_of_its_topics():
    port = free_port()
    with zenoh.open(session_config(f"tcp/127.0.0.1:{port}", mode="router")) as robot:
        with zenoh.open(session_config(f"tcp/127.0.0.1:{port}")) as session:
            graph = Graph(session)
            graph.subscribes("another/dialect")
            assert not shown(robot)
            graph.publishes(f"0/cmd_vel/geometry_msgs::msg::dds_::Twist_/{HASH}")
            graph.subscribes(f"0/odom/nav_msgs::msg::dds_::Odometry_/{HASH}")
            until(lambda: len(shown(robot)) == 3)
            assert [token.split("/")[3:6] for token in shown(robot)] == [
                ["0", "0", "NN"],
                ["0", "1", "MP"],
                ["0", "2", "MS"],
            ]
        until(lambda: not shown(robot))


def shown(session):
    replies = session.liveliness().get("@ros2_lv/0/**", timeout=1.0)
    return sorted(str(reply.ok.key_expr) for reply in replies if reply.ok)
