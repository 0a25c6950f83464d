"""Zenoh keys of ROS 2 topics in both dialects, and rmw_zenoh's attachment.

zenoh-bridge-ros2dds uses the topic's name alone. rmw_zenoh puts the domain before it and behind it the type's
DDS name and RIHS01 hash (REP 2016), as its ``liveliness_utils.cpp`` does.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import TYPE_CHECKING

from adatracker_quadruped.protocol import cdr as protocol
from adatracker_quadruped.protocol import sport, unitree
from adatracker_quadruped.protocol.cdr import Malformed

if TYPE_CHECKING:
    from adatracker_quadruped.protocol.connection import Connection

_ODOMETRY_TYPES = {"odometry": protocol.ODOMETRY, "sport_mode_state": unitree.SPORT_MODE_STATE}
_BATTERY_TYPES = {"battery_state": protocol.BATTERY_STATE, "low_state": unitree.LOW_STATE}
_COMMAND_TYPES = {
    "twist": protocol.TWIST,
    "twist_stamped": protocol.TWIST_STAMPED,
    "unitree_sport": sport.REQUEST,
}
GID_BYTES = 16
"""RMW_GID_STORAGE_SIZE."""
_ATTACHMENT = struct.Struct(f"<qqB{GID_BYTES}s")
"""Sequence number and time as int64, little-endian, then the gid as zenoh-ext writes an array: length first.

So in rmw_zenoh since 0.2.4 (``attachment_helpers.cpp``); before, each field came after its name.
"""


@dataclass(frozen=True, slots=True)
class Keys:
    """The key expressions of a connection's topics; empty where the topic is."""

    connection: Connection

    @property
    def command(self) -> str:
        """Key of the commands, of the connection's message type."""
        return self._key(self.connection.command_topic, _COMMAND_TYPES[self.connection.command])

    @property
    def odometry(self) -> str:
        """Key of the odometry, of the connection's message type."""
        return self._key(self.connection.odometry_topic, _ODOMETRY_TYPES[self.connection.odometry])

    @property
    def imu(self) -> str:
        """Key of sensor_msgs/Imu."""
        return self._key(self.connection.imu_topic, protocol.IMU)

    @property
    def battery(self) -> str:
        """Key of the charge, of the connection's message type."""
        return self._key(self.connection.battery_topic, _BATTERY_TYPES[self.connection.battery])

    @property
    def camera(self) -> str:
        """Key of sensor_msgs/CompressedImage."""
        return self._key(self.connection.camera_topic, protocol.COMPRESSED_IMAGE)

    @property
    def robot_token(self) -> str:
        """Key of a liveliness token that the host takes for the robot's; empty where it watches none."""
        return self.connection.robot_liveliness.replace("**", "robot").replace("*", "robot")

    @property
    def attaches(self) -> bool:
        """Whether every message carries an `attachment`; without one rmw_zenoh drops it."""
        return self.connection.dialect == "rmw_zenoh"

    def _key(self, topic: str, type_name: str) -> str:
        if not topic:
            return ""
        name = f"{self.connection.namespace}/{topic.lstrip('/')}".lstrip("/")
        if self.connection.dialect == "ros2dds":
            return name
        hashes = self.connection.type_hashes
        type_hash = protocol.STORE.hash_rihs01(type_name) if hashes else "TypeHashNotSupported"
        return f"{self.connection.domain}/{name}/{_dds_name(type_name)}/{type_hash}"


def attachment(sequence: int, t_ns: int, gid: bytes) -> bytes:
    """Return what rmw_zenoh attaches to a message.

    Args:
        sequence: counts the publisher's messages.
        t_ns: when it was sent, ns since 1970.
        gid: the publisher's identity; zeros fill it up to 16 bytes.
    """
    return _ATTACHMENT.pack(sequence, t_ns, GID_BYTES, gid)


def parse_attachment(payload: bytes) -> tuple[int, int, bytes]:
    """Return (sequence, t_ns, gid) of an attachment.

    Raises:
        Malformed: it is not one, or one of rmw_zenoh 0.2.3 or older.
    """
    if len(payload) != _ATTACHMENT.size or payload[16] != GID_BYTES:
        raise Malformed(f"an attachment of {len(payload)} bytes is not rmw_zenoh's")
    sequence, t_ns, _, gid = _ATTACHMENT.unpack(payload)
    return sequence, t_ns, gid


def _dds_name(type_name: str) -> str:
    """Return ``geometry_msgs::msg::dds_::Twist_`` of ``geometry_msgs/msg/Twist``."""
    package, kind, name = type_name.split("/")
    return f"{package}::{kind}::dds_::{name}_"
