"""The profile's ``connection:`` section: how the quadruped is reached and commanded."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Annotated, Literal

from adatracker_deploy.config.schema import Range
from adatracker_deploy.core.errors import UsageError

_ENDPOINT = re.compile(r"(?:tcp|tls)/(?:[A-Za-z0-9_.-]+|\[[0-9A-Fa-f:.]+\]):([0-9]{1,5})")
_ROS_NAME = re.compile(r"/?[A-Za-z_][A-Za-z0-9_]*(?:/[A-Za-z_][A-Za-z0-9_]*)*")
"""A topic or namespace by ROS 2's naming rules (design.ros2.org, "Topic and Service name mapping to DDS")."""
_KEY = re.compile(r"[^/*$?#\s]+(?:/[^/*$?#\s]+)*")
_KEY_EXPRESSION = re.compile(r"(?:\*{1,2}|[^/*$?#\s]+)(?:/(?:\*{1,2}|[^/*$?#\s]+))*")
"""Zenoh's key expressions: chunks without ``*$?#`` between single slashes; ``*`` and ``**`` stand for any."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Tls:
    """PEM files for an endpoint that starts with ``tls/``; an empty name leaves that part out."""

    root_ca: str = ""
    """The authority that signed the robot's certificate; without one, the authorities that browsers trust."""
    certificate: str = ""
    """This host's own certificate, for a robot that asks who connects (mutual TLS)."""
    private_key: str = ""
    """The key of `certificate`; nobody but its owner may be able to read it."""
    verify_name: bool = True
    """Refuse a certificate that was not issued for the name or address in the endpoint."""

    def __post_init__(self) -> None:
        if bool(self.certificate) != bool(self.private_key):
            raise UsageError(
                "connection.tls: certificate and private_key go together; one of them is missing"
            )


@dataclass(frozen=True, slots=True, kw_only=True)
class Connection:
    """A robot that speaks ROS 2 over Zenoh; time-outs are the machine's seconds at any clock speed.

    Topics may be written with or without a leading slash; an empty one is not there.
    """

    endpoint: str = "tcp/127.0.0.1:7447"
    """The robot's Zenoh router or bridge. Only this side dials: dialling both ways can split a session."""
    dialect: Literal["ros2dds", "rmw_zenoh"] = "ros2dds"
    """zenoh-bridge-ros2dds beside any ROS 2 robot, or a robot whose own middleware is rmw_zenoh."""
    command: Literal["twist", "twist_stamped", "unitree_sport"] = "twist"
    command_topic: str = "cmd_vel"
    command_frame: str = "base_link"
    """``frame_id`` of a TwistStamped."""
    odometry: Literal["odometry", "sport_mode_state"] = "odometry"
    """nav_msgs/Odometry, or Unitree's own SportModeState."""
    odometry_topic: str = "odom"
    imu_topic: str = ""
    battery: Literal["battery_state", "low_state"] = "battery_state"
    """sensor_msgs/BatteryState, or Unitree's own LowState."""
    battery_topic: str = ""
    camera_topic: str = ""
    """A topic of sensor_msgs/CompressedImage."""
    namespace: str = ""
    """Put before every topic: the bridge's ``namespace``, or that of the robot's ROS 2 nodes."""
    domain: Annotated[int, Range(0, 232)] = 0
    """ROS_DOMAIN_ID; only in the keys of ``rmw_zenoh``."""
    type_hashes: bool = True
    """False for ``rmw_zenoh`` of ROS 2 Humble, whose keys end in TypeHashNotSupported."""
    robot_liveliness: str = ""
    """Key expression of a liveliness token of the robot's; the robot is gone when its last one is."""
    host_token: str = "adatracker/host"
    """Key of the liveliness token that this host declares; a robot can stop at once when it goes."""
    tls: Tls | None = None
    min_battery: Annotated[float, Range(0, 1)] = 0.2
    """Charge needed to engage; 0 also accepts a robot that does not tell it."""
    battery_timeout_s: Annotated[float, Range(1, 600)] = 30.0
    """Age after which a reported charge is dropped, and the robot is stopped."""
    connect_timeout_s: Annotated[float, Range(0.1, 30)] = 1.5
    """Time-out of the connection; a robot on the same network answers in milliseconds."""
    lease_s: Annotated[float, Range(0.1, 10)] = 1.0
    """A peer that is silent for this long is gone: how soon a frozen or cut-off robot is noticed."""
    odometry_timeout_s: Annotated[float, Range(0.05, 5)] = 0.3
    """Without odometry for this long the robot is walked no further."""
    odometry_velocity: Literal["body", "odom"] = "body"
    """Axes of the odometry's twist: ``child_frame_id`` by ROS's rule, or its own (Spot's driver)."""
    rehearsal_token: str = ""
    """Set by ``--sitl``: the robot must show this, or it is somebody else's and is sent nothing."""
    command_timeout_s: Annotated[float, Range(0.05, 5)] = 0.5
    """The robot's own: it stops when no command has come for this long."""

    @property
    def robot(self) -> str:
        """Name the quadruped's connection: the same in every run on this machine that would reach it."""
        return f"zenoh:{self.endpoint}:{self.host_token}"

    def __post_init__(self) -> None:
        self._check_endpoint()
        for name in ("command_topic", "odometry_topic"):
            if not getattr(self, name):
                raise UsageError(f"connection: {name} is empty; a robot cannot be walked without it")
        for name in (*_TOPICS, "namespace"):
            value = getattr(self, name)
            if value and not _ROS_NAME.fullmatch(value):
                raise UsageError(
                    f"connection: {name} {value!r} is not a ROS 2 name: letters, digits and underscores "
                    "between single slashes, such as camera/image_raw/compressed"
                )
        topics = [getattr(self, name).strip("/") for name in _TOPICS if getattr(self, name)]
        for topic in topics:
            if topics.count(topic) > 1:
                raise UsageError(
                    f"connection: topic {topic!r} is named twice; each carries one type of message"
                )
        if not _KEY.fullmatch(self.host_token):
            raise UsageError(
                f"connection: host_token {self.host_token!r} is not a Zenoh key, such as adatracker/host"
            )
        if self.robot_liveliness and not _KEY_EXPRESSION.fullmatch(self.robot_liveliness):
            raise UsageError(
                f"connection: robot_liveliness {self.robot_liveliness!r} is not a Zenoh key expression, "
                "such as robot/alive or robot/*"
            )

    def _check_endpoint(self) -> None:
        match = _ENDPOINT.fullmatch(self.endpoint)
        if match is None or not 0 < int(match[1]) < 2**16:
            raise UsageError(
                f"connection: endpoint {self.endpoint!r} is not one to connect to: use for example "
                "tcp/192.168.1.20:7447 or tls/robot.local:7447"
            )
        if self.tls is not None and not self.endpoint.startswith("tls/"):
            raise UsageError(
                f"connection: tls is set but endpoint {self.endpoint!r} is not encrypted: use tls/..."
            )


_TOPICS = ("command_topic", "odometry_topic", "imu_topic", "battery_topic", "camera_topic")
