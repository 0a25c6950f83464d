"""ROS 2 messages as the toolkit's values, and back: velocities, odometry, inertia, battery, images.

Frames are REP 103's and REP 105's on both sides: a pose is that of ``child_frame_id`` (the body: x forward,
y left, z up) in ``frame_id`` (fixed: x east or start-forward), a velocity is in the body. Only attitudes
change their form, here and nowhere else: a unit quaternion on the wire, `Pose`'s angles inside. Covariances
are not read, and are written as zeros: unknown (sensor_msgs/Imu).

Every decoder raises `Malformed`, and nothing else, whatever the bytes: no value that is not finite, no
quaternion that is not of unit length and no time before 1970 comes out of it.
"""

from __future__ import annotations

import math
from dataclasses import astuple, dataclass
from typing import Any

import numpy as np

from adatracker_deploy.errors import PlatformError
from adatracker_deploy.geometry import Pose
from adatracker_deploy.platform import Twist
from adatracker_quadruped import protocol
from adatracker_quadruped.protocol import Malformed

__all__ = [
    "CompressedImage",
    "Imu",
    "Malformed",
    "Odometry",
    "StampedTwist",
    "decode_battery",
    "decode_compressed_image",
    "decode_imu",
    "decode_odometry",
    "decode_twist",
    "decode_twist_stamped",
    "encode_battery",
    "encode_compressed_image",
    "encode_imu",
    "encode_odometry",
    "encode_twist",
    "encode_twist_stamped",
]

FASTEST = 100.0
"""m/s and rad/s; nothing above this is a command or a measurement of a walking robot."""
FARTHEST_M = 1e8
"""From a frame's origin; UTM northings reach 1e7 m."""
STRONGEST_M_S2 = 1e4
"""A hard landing has hundreds of m/s^2."""

_UNIT_TOLERANCE = 10e-3
"""Of a quaternion's squared length: what tf2 accepts (QUATERNION_NORMALIZATION_TOLERANCE)."""
_TYPES = protocol.STORE.types


@dataclass(frozen=True, slots=True)
class StampedTwist:
    """A velocity with its sender's time, ns since 1970 by the sender's clock, and frame."""

    twist: Twist
    stamp_ns: int
    frame_id: str


@dataclass(frozen=True, slots=True)
class Odometry:
    """nav_msgs/Odometry: where the body is in a fixed frame, and its velocity in its own."""

    pose: Pose
    velocity: Twist
    stamp_ns: int
    """Since 1970, by the robot's clock."""
    frame_id: str = "odom"
    child_frame_id: str = "base_link"


@dataclass(frozen=True, slots=True)
class Imu:
    """sensor_msgs/Imu in the body's axes; `attitude` is (roll, pitch, yaw), rad, or None if not estimated."""

    attitude: tuple[float, float, float] | None
    angular_velocity_rad_s: tuple[float, float, float]
    acceleration_m_s2: tuple[float, float, float]
    """Specific force: +9.81 on z at rest."""
    stamp_ns: int
    """Since 1970, by the robot's clock."""
    frame_id: str = "imu_link"


@dataclass(frozen=True, slots=True)
class CompressedImage:
    """sensor_msgs/CompressedImage: an encoded image, not yet looked into."""

    stamp_ns: int
    """Since 1970, by the robot's clock."""
    format: str
    """``jpeg``, ``png`` or, by image_transport, such as ``rgb8; jpeg compressed bgr8``."""
    data: bytes | memoryview
    """The encoded image; decoded from a payload it is a view of it, and never empty."""
    frame_id: str = "camera"


def encode_twist(twist: Twist) -> bytes:
    """Return geometry_msgs/Twist.

    Raises:
        PlatformError: a component is NaN, infinite or beyond `FASTEST`.
    """
    return protocol.encode(_twist_message(twist), protocol.TWIST)


def decode_twist(payload: bytes) -> Twist:
    """Return the velocity in a geometry_msgs/Twist; roll and pitch rates are checked and left out."""
    return _twist(protocol.decode(payload, protocol.TWIST))


def encode_twist_stamped(twist: Twist, t_ns: int, frame_id: str) -> bytes:
    """Return geometry_msgs/TwistStamped; `t_ns` is since 1970, `frame_id` the body's frame.

    Raises:
        PlatformError: as `encode_twist`.
    """
    message = _TYPES[protocol.TWIST_STAMPED](header=_header(t_ns, frame_id), twist=_twist_message(twist))
    return protocol.encode(message, protocol.TWIST_STAMPED)


def decode_twist_stamped(payload: bytes) -> StampedTwist:
    """Return the velocity in a geometry_msgs/TwistStamped."""
    message = protocol.decode(payload, protocol.TWIST_STAMPED)
    return StampedTwist(_twist(message.twist), _stamp_ns(message.header), message.header.frame_id)


def encode_odometry(odometry: Odometry) -> bytes:
    """Return nav_msgs/Odometry with covariances of zero."""
    pose, unknown = odometry.pose, np.zeros(36)
    place = _TYPES["geometry_msgs/msg/Point"](x=pose.x, y=pose.y, z=pose.z)
    attitude = _quaternion_message((pose.roll, pose.pitch, pose.yaw))
    message = _TYPES[protocol.ODOMETRY](
        header=_header(odometry.stamp_ns, odometry.frame_id),
        child_frame_id=odometry.child_frame_id,
        pose=_TYPES["geometry_msgs/msg/PoseWithCovariance"](
            pose=_TYPES["geometry_msgs/msg/Pose"](position=place, orientation=attitude), covariance=unknown
        ),
        twist=_TYPES["geometry_msgs/msg/TwistWithCovariance"](
            twist=_twist_message(odometry.velocity), covariance=unknown
        ),
    )
    return protocol.encode(message, protocol.ODOMETRY)


def decode_odometry(payload: bytes) -> Odometry:
    """Return the pose and the velocity in a nav_msgs/Odometry."""
    message = protocol.decode(payload, protocol.ODOMETRY)
    pose = message.pose.pose
    x, y, z = _vector(pose.position, FARTHEST_M)
    roll, pitch, yaw = _attitude(pose.orientation)
    return Odometry(
        pose=Pose(x, y, z, roll, pitch, yaw),
        velocity=_twist(message.twist.twist),
        stamp_ns=_stamp_ns(message.header),
        frame_id=message.header.frame_id,
        child_frame_id=message.child_frame_id,
    )


def encode_imu(imu: Imu) -> bytes:
    """Return sensor_msgs/Imu; without an attitude its covariance begins with -1, as the message asks."""
    unknown, absent = np.zeros(9), np.array([-1.0, *[0.0] * 8])
    message = _TYPES[protocol.IMU](
        header=_header(imu.stamp_ns, imu.frame_id),
        orientation=_quaternion_message(imu.attitude or (0.0, 0.0, 0.0)),
        orientation_covariance=absent if imu.attitude is None else unknown,
        angular_velocity=_vector_message(imu.angular_velocity_rad_s),
        angular_velocity_covariance=unknown,
        linear_acceleration=_vector_message(imu.acceleration_m_s2),
        linear_acceleration_covariance=unknown,
    )
    return protocol.encode(message, protocol.IMU)


def decode_imu(payload: bytes) -> Imu:
    """Return what a sensor_msgs/Imu says."""
    message = protocol.decode(payload, protocol.IMU)
    return Imu(
        attitude=None if message.orientation_covariance[0] == -1 else _attitude(message.orientation),
        angular_velocity_rad_s=_vector(message.angular_velocity, FASTEST),
        acceleration_m_s2=_vector(message.linear_acceleration, STRONGEST_M_S2),
        stamp_ns=_stamp_ns(message.header),
        frame_id=message.header.frame_id,
    )


def encode_battery(charge: float | None, stamp_ns: int = 0) -> bytes:
    """Return sensor_msgs/BatteryState with this state of charge (0 to 1; None is unknown) and little else."""
    unknown = math.nan  # what the message asks for where nothing is measured
    message = _TYPES[protocol.BATTERY_STATE](
        header=_header(stamp_ns, ""),
        **dict.fromkeys(_BATTERY_MEASURES, unknown),
        percentage=unknown if charge is None else charge,
        power_supply_status=0,
        power_supply_health=0,
        power_supply_technology=0,
        present=True,
        cell_voltage=np.zeros(0, np.float32),
        cell_temperature=np.zeros(0, np.float32),
        location="",
        serial_number="",
    )
    return protocol.encode(message, protocol.BATTERY_STATE)


def decode_battery(payload: bytes) -> float | None:
    """Return the state of charge in a sensor_msgs/BatteryState, 0 to 1, or None where it says NaN: unknown.

    A percentage above 1 is `Malformed`: there are drivers that send 0 to 100, and 1 of those is not full.
    """
    charge = float(protocol.decode(payload, protocol.BATTERY_STATE).percentage)
    if math.isnan(charge):
        return None
    if not 0.0 <= charge <= 1.0:
        raise Malformed(f"battery percentage {charge:g} is not between 0 and 1")
    return charge


def encode_compressed_image(image: CompressedImage) -> bytes:
    """Return sensor_msgs/CompressedImage."""
    message = _TYPES[protocol.COMPRESSED_IMAGE](
        header=_header(image.stamp_ns, image.frame_id),
        format=image.format,
        data=np.frombuffer(image.data, np.uint8),
    )
    return protocol.encode(message, protocol.COMPRESSED_IMAGE)


def decode_compressed_image(payload: bytes) -> CompressedImage:
    """Return the image in a sensor_msgs/CompressedImage of at most `protocol.IMAGE_CAP_BYTES`."""
    message = protocol.decode(payload, protocol.COMPRESSED_IMAGE, protocol.IMAGE_CAP_BYTES)
    if not message.data.size:
        raise Malformed("an image without data")
    return CompressedImage(
        stamp_ns=_stamp_ns(message.header),
        format=message.format,
        data=memoryview(message.data),
        frame_id=message.header.frame_id,
    )


_BATTERY_MEASURES = ("voltage", "temperature", "current", "charge", "capacity", "design_capacity")


def _header(stamp_ns: int, frame_id: str) -> Any:
    time = _TYPES["builtin_interfaces/msg/Time"](sec=stamp_ns // 10**9, nanosec=stamp_ns % 10**9)
    return _TYPES["std_msgs/msg/Header"](stamp=time, frame_id=frame_id)


def _stamp_ns(header: Any) -> int:
    sec, nanosec = header.stamp.sec, header.stamp.nanosec
    if sec < 0 or nanosec >= 10**9:
        raise Malformed(f"no time has {sec} s and {nanosec} ns")
    return int(sec * 10**9 + nanosec)


def _twist_message(twist: Twist) -> Any:
    if not all(abs(value) <= FASTEST for value in astuple(twist)):
        raise PlatformError(f"refused to send {twist}: not a velocity that a quadruped can walk")
    linear = _vector_message((twist.vx, twist.vy, twist.vz))
    angular = _vector_message((0.0, 0.0, twist.yaw_rate))
    return _TYPES[protocol.TWIST](linear=linear, angular=angular)


def _twist(message: Any) -> Twist:
    vx, vy, vz = _vector(message.linear, FASTEST)
    _, _, yaw_rate = _vector(message.angular, FASTEST)
    return Twist(vx, vy, vz, yaw_rate)


def _vector_message(xyz: tuple[float, float, float]) -> Any:
    x, y, z = xyz
    return _TYPES["geometry_msgs/msg/Vector3"](x=x, y=y, z=z)


def _vector(message: Any, largest: float) -> tuple[float, float, float]:
    xyz = (message.x, message.y, message.z)
    if not all(abs(value) <= largest for value in xyz):  # false for NaN too
        raise Malformed(f"{xyz} has a component that is no number up to {largest:g}")
    return xyz


def _quaternion_message(attitude: tuple[float, float, float]) -> Any:
    """Return the quaternion of Rz(yaw) Ry(pitch) Rx(roll)."""
    roll, pitch, yaw = attitude
    cr, sr = math.cos(roll / 2), math.sin(roll / 2)
    cp, sp = math.cos(pitch / 2), math.sin(pitch / 2)
    cy, sy = math.cos(yaw / 2), math.sin(yaw / 2)
    return _TYPES["geometry_msgs/msg/Quaternion"](
        x=sr * cp * cy - cr * sp * sy,
        y=cr * sp * cy + sr * cp * sy,
        z=cr * cp * sy - sr * sp * cy,
        w=cr * cp * cy + sr * sp * sy,
    )


def _attitude(quaternion: Any) -> tuple[float, float, float]:
    """Return roll, pitch and yaw of a unit quaternion, as `Pose` means them."""
    x, y, z, w = quaternion.x, quaternion.y, quaternion.z, quaternion.w
    square = x * x + y * y + z * z + w * w
    if not abs(square - 1.0) < _UNIT_TOLERANCE:  # false for NaN too
        raise Malformed(f"quaternion ({x:g}, {y:g}, {z:g}, {w:g}) is not of unit length")
    roll = math.atan2(2 * (w * x + y * z), w * w - x * x - y * y + z * z)
    pitch = math.asin(max(-1.0, min(1.0, 2 * (w * y - z * x) / square)))
    yaw = math.atan2(2 * (w * z + x * y), w * w + x * x - y * y - z * z)
    return roll, pitch, yaw
