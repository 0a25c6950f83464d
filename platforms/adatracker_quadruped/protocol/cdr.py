"""CDR serialisation of ROS 2 messages: one type store, one encoder, one hardened decoder.

It does no I/O. `messages` and `sport` interpret the messages.
"""

from __future__ import annotations

from typing import Any

from rosbags.typesys import Stores, get_typestore

TWIST = "geometry_msgs/msg/Twist"
TWIST_STAMPED = "geometry_msgs/msg/TwistStamped"
ODOMETRY = "nav_msgs/msg/Odometry"
IMU = "sensor_msgs/msg/Imu"
BATTERY_STATE = "sensor_msgs/msg/BatteryState"
COMPRESSED_IMAGE = "sensor_msgs/msg/CompressedImage"

SMALL_CAP_BYTES = 4096
"""No longer payload is decoded; a full Odometry with long frame names has under 1 KiB."""
STORE = get_typestore(Stores.ROS2_JAZZY)
"""Message types as of Jazzy, the first long-term release with rmw_zenoh.

The six above are the same, field by field, from Dashing to Lyrical, so this speaks to every ROS 2 robot.
"""

for _name in (TWIST, TWIST_STAMPED, ODOMETRY, IMU, BATTERY_STATE, COMPRESSED_IMAGE):
    STORE.get_msgdef(_name)  # made at the first use otherwise, which would be late by up to 20 ms


class Malformed(ValueError):  # noqa: N818 - what the payload is
    """A payload that is not the message it should be; it is to be dropped and counted."""


def encode(message: object, type_name: str) -> bytes:
    """Return a message of `STORE` as little-endian CDR with its encapsulation header (00 01 00 00)."""
    return bytes(STORE.serialize_cdr(message, type_name, little_endian=True))


def decode(payload: bytes, type_name: str, cap_bytes: int = SMALL_CAP_BYTES) -> Any:
    """Return the message of `STORE` in a CDR payload of either byte order.

    Sequences in it are views of `payload`, and no length in it is believed beyond the payload's end, so that
    memory is bounded by the payload's own.

    Raises:
        Malformed: longer than `cap_bytes`, another encapsulation, cut short, too long, or not text where text
            must be.
    """
    if len(payload) > cap_bytes:
        raise Malformed(f"{type_name}: {len(payload)} bytes are more than {cap_bytes}")
    try:
        return STORE.deserialize_cdr(memoryview(payload), type_name)  # which slices: a view copies nothing
    except Exception as error:  # whatever malformed bytes make the generated decoder raise
        raise Malformed(f"{type_name}: {error}") from error
