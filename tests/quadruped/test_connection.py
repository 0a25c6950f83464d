"""The profile's connection section: what it takes, and how it refuses the rest."""

import dataclasses

import pytest

from adatracker_deploy.config.schema import parse
from adatracker_deploy.core.errors import UsageError
from adatracker_quadruped.protocol.connection import Connection, Tls


def test_a_profile_is_read_into_it():
    section = {
        "endpoint": "tls/spot.local:7447",
        "dialect": "rmw_zenoh",
        "command": "twist_stamped",
        "camera_topic": "/camera/image_raw/compressed",
        "namespace": "spot",
        "domain": 7,
        "robot_liveliness": "robot/*/alive",
        "tls": {"root_ca": "ca.pem", "certificate": "host.pem", "private_key": "host.key"},
    }
    connection = parse(Connection, section, where="connection")
    assert connection.tls == Tls(root_ca="ca.pem", certificate="host.pem", private_key="host.key")
    assert (connection.domain, connection.camera_topic) == (7, "/camera/image_raw/compressed")


def test_its_time_outs_stop_a_robot_in_time_when_nothing_else_is_said():
    connection = Connection()
    assert connection.odometry_timeout_s == 0.3
    assert connection.command_timeout_s == 0.5
    assert connection.lease_s == 1.0
    assert connection.connect_timeout_s < 2.0


@pytest.mark.parametrize(
    "endpoint",
    ["tcp/127.0.0.1:7447", "tcp/robot.local:1", "tcp/[fe80::1]:65535", "tls/192.168.1.20:7447"],
)
def test_an_endpoint_is_a_transport_a_host_and_a_port(endpoint):
    assert Connection(endpoint=endpoint).endpoint == endpoint


@pytest.mark.parametrize(
    ("field", "value", "reason"),
    [
        ("endpoint", "", "not one to connect to"),
        ("endpoint", "127.0.0.1:7447", "not one to connect to"),
        ("endpoint", "udp/127.0.0.1:7447", "not one to connect to"),
        ("endpoint", "tcp/127.0.0.1", "not one to connect to"),
        ("endpoint", "tcp/127.0.0.1:0", "not one to connect to"),
        ("endpoint", "tcp/127.0.0.1:65536", "not one to connect to"),
        ("endpoint", "tcp/127.0.0.1:7447#iface=eth0", "not one to connect to"),
        ("endpoint", "tcp/127.0.0.1:7447\n", "not one to connect to"),
        ("command_topic", "", "cannot be walked without"),
        ("odometry_topic", "", "cannot be walked without"),
        ("command_topic", "cmd_vel/", "not a ROS 2 name"),
        ("command_topic", "//cmd_vel", "not a ROS 2 name"),
        ("odometry_topic", "**", "not a ROS 2 name"),
        ("camera_topic", "camera raw", "not a ROS 2 name"),
        ("battery_topic", "1st/battery", "not a ROS 2 name"),
        ("namespace", "a//b", "not a ROS 2 name"),
        ("imu_topic", "/odom", "named twice"),
        ("host_token", "", "not a Zenoh key"),
        ("host_token", "/host", "not a Zenoh key"),
        ("host_token", "host/*", "not a Zenoh key"),
        ("robot_liveliness", "robot/", "not a Zenoh key expression"),
        ("robot_liveliness", "robot/a*", "not a Zenoh key expression"),
        ("robot_liveliness", "robot?", "not a Zenoh key expression"),
        ("tls", Tls(), "is not encrypted"),
    ],
)
def test_nonsense_is_refused_in_one_line_that_names_it(field, value, reason):
    with pytest.raises(UsageError, match=reason) as refusal:
        dataclasses.replace(Connection(), **{field: value})
    assert "\n" not in str(refusal.value)


def test_a_certificate_goes_with_its_key():
    with pytest.raises(UsageError, match="go together"):
        Tls(certificate="host.pem")
    with pytest.raises(UsageError, match="go together"):
        Tls(private_key="host.key")
