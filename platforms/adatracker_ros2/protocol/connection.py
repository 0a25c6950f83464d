"""The profile's ``connection:`` section: how a ROS 2 robot is found and commanded."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from typing import Annotated, Literal

from adatracker_deploy.config.schema import Range
from adatracker_deploy.core.errors import UsageError

_ROS_NAME = re.compile(r"/?[A-Za-z_][A-Za-z0-9_]*(?:/[A-Za-z_][A-Za-z0-9_]*)*")
"""A topic, node or namespace by ROS 2's naming rules (design.ros2.org, "Topic and Service name mapping to
DDS")."""
_PEER = re.compile(r"[A-Za-z0-9_.:-]+")
_TOKEN = re.compile(r"[0-9a-f]{32}")


@dataclass(frozen=True, slots=True, kw_only=True)
class Qos:
    """Quality of service of one topic, on this host's side; only the newest messages are kept.

    Who publishes reliably can be heard as best effort, not the other way round; likewise transient local and
    volatile (docs.ros.org, "Quality of Service settings").
    """

    reliability: Literal["reliable", "best_effort"] = "best_effort"
    durability: Literal["volatile", "transient_local"] = "volatile"
    depth: Annotated[int, Range(1, 100)] = 1


@dataclass(frozen=True, slots=True, kw_only=True)
class Connection:
    """A ROS 2 robot; time-outs are the machine's seconds at any clock speed.

    A topic is relative to `namespace` unless it starts with a slash; an empty one is not there.
    """

    domain: Annotated[int, Range(0, 232)] = 0
    """ROS_DOMAIN_ID; the environment's is not looked at."""
    discovery: Literal["subnet", "localhost"] = "subnet"
    """ROS_AUTOMATIC_DISCOVERY_RANGE: by multicast in the network, or on this machine and at `peers` only."""
    peers: str = ""
    """ROS_STATIC_PEERS: addresses of other machines, with semicolons between."""
    namespace: str = ""
    """Put before every relative name."""
    command: Literal["twist", "twist_stamped"] = "twist"
    command_topic: str = "cmd_vel"
    command_frame: str = "base_link"
    """``frame_id`` of a TwistStamped."""
    command_qos: Qos = field(default_factory=lambda: Qos(reliability="reliable"))
    odometry_topic: str = "odom"
    odometry_qos: Qos = field(default_factory=Qos)
    odometry_velocity: Literal["body", "odom"] = "body"
    """Axes of the odometry's twist: ``child_frame_id`` by ROS's rule, or its own."""
    battery_topic: str = ""
    """A topic of sensor_msgs/BatteryState."""
    camera_topic: str = ""
    """A topic of sensor_msgs/CompressedImage or sensor_msgs/Image."""
    camera_info_topic: str = ""
    """A topic of sensor_msgs/CameraInfo; empty for ``camera_info`` beside the images."""
    camera_qos: Qos = field(default_factory=Qos)
    driver_node: str = ""
    """The node that takes the commands; asked in the preflight for what follows."""
    timeout_parameter: str = ""
    """Its parameter with the robot's own time-out, s, such as ``cmd_vel_timeout``."""
    lifecycle: bool = False
    """It is a managed node, and must be active."""
    min_battery: Annotated[float, Range(0, 1)] = 0.0
    """Charge needed to engage; 0 also accepts a robot that does not tell it."""
    battery_timeout_s: Annotated[float, Range(1, 600)] = 30.0
    """Age after which a reported charge is dropped, and the robot is stopped."""
    connect_timeout_s: Annotated[float, Range(0.1, 30)] = 5.0
    """Time-out of the search for the robot; in one network it is found within a second."""
    odometry_timeout_s: Annotated[float, Range(0.05, 5)] = 0.3
    """Without odometry for this long the robot is driven no further."""
    command_timeout_s: Annotated[float, Range(0.05, 5)] = 0.5
    """The robot's own: it stops when no command has come for this long."""
    rehearsal_token: str = ""
    """Set by ``--sitl``: put before every name, so that nobody but the simulated robot is spoken to."""

    def __post_init__(self) -> None:
        for name in ("command_topic", "odometry_topic"):
            if not getattr(self, name):
                raise UsageError(f"connection: {name} is empty; a robot cannot be driven without it")
        for name in (*_TOPICS, "namespace", "driver_node"):
            value = getattr(self, name)
            if value and not _ROS_NAME.fullmatch(value):
                raise UsageError(
                    f"connection: {name} {value!r} is not a ROS 2 name: letters, digits and underscores "
                    "between single slashes, such as camera/image_raw/compressed"
                )
        named = [getattr(self, name) for name in _TOPICS if getattr(self, name)]
        for topic in named:
            if named.count(topic) > 1:
                raise UsageError(
                    f"connection: topic {topic!r} is named twice; each carries one type of message"
                )
        if any(not _PEER.fullmatch(peer) for peer in self.peers.split(";") if peer):
            raise UsageError(
                f"connection: peers {self.peers!r} are not addresses with semicolons between, such as "
                "192.168.1.20;robot.local"
            )
        if (self.timeout_parameter or self.lifecycle) and not self.driver_node:
            raise UsageError("connection: timeout_parameter and lifecycle are a node's: name driver_node too")
        if self.rehearsal_token and not _TOKEN.fullmatch(self.rehearsal_token):
            raise UsageError("connection: rehearsal_token is set by --sitl; leave it out")


_TOPICS = ("command_topic", "odometry_topic", "battery_topic", "camera_topic", "camera_info_topic")
