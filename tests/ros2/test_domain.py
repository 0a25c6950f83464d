"""Domains of rehearsals: empty, and each somebody's own."""

import socket

import pytest

from adatracker_deploy.core.errors import PlatformError
from adatracker_ros2.sim import domain
from adatracker_ros2.sim.domain import ReservedDomain


@pytest.fixture(autouse=True)
def _two_domains_above_the_ephemeral_ports(monkeypatch):
    monkeypatch.setattr(domain, "DOMAINS", range(220, 222))


def test_each_is_reserved_once_and_can_be_given_back():
    with ReservedDomain() as one, ReservedDomain() as other:
        assert {one.number, other.number} == {220, 221}
        with pytest.raises(PlatformError, match="every ROS 2 domain of this machine, 220 to 221, is in use"):
            ReservedDomain()
        one.close()
        with ReservedDomain() as again:
            assert again.number == one.number


@pytest.mark.parametrize("participant", [0, 3])
def test_one_in_which_somebody_listens_is_left_alone(participant):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as somebody:
        somebody.bind(("127.0.0.1", 7400 + 250 * 220 + 10 + 2 * participant))
        for _ in range(10):
            with ReservedDomain() as reserved:
                assert reserved.number == 221


def test_a_node_of_rclpy_is_somebody(monkeypatch):
    pytest.importorskip("rclpy", reason="ROS 2 is not installed: pip install 'adatracker-deploy[ros2]'")
    from adatracker_ros2.protocol.connection import Connection
    from adatracker_ros2.protocol.participant import Participant

    monkeypatch.setattr(domain, "DOMAINS", range(220, 221))
    participant = Participant(Connection(domain=220, discovery="localhost"), "somebody")
    try:
        with pytest.raises(PlatformError, match="in use"):
            ReservedDomain()
    finally:
        participant.close()
    ReservedDomain().close()
