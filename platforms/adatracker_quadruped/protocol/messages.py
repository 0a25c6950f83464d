"""Converts between ROS 2 messages and the toolkit's values: velocities, odometry, IMU, battery, images.

Frames are REP 103's and REP 105's on both sides: a pose is that of ``child_frame_id`` (the body: x forward, y
left, z up) in ``frame_id`` (fixed: x east or start-forward), a velocity is in the body; `in_body` converts
one that is not. Only attitudes change their form, in `ros_types`: a unit quaternion in messages, `Pose`'s
angles inside. Covariances are not read, and are written as zeros: unknown (sensor_msgs/Imu).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from adatracker_deploy.core.geometry import Matrix, Pose
from adatracker_deploy.core.messages import Twist
from adatracker_deploy.perception.compressed_image import CompressedImage, read_compressed_image
from adatracker_quadruped.protocol import cdr as protocol
from adatracker_quadruped.protocol.ros_types import (
    FASTEST,
    Triple,
    read_attitude,
    read_stamp_ns,
    read_twist,
    read_vector,
    write_attitude,
    write_header,
    write_twist,
    write_vector,
)

Malformed = protocol.Malformed
"""The only exception that decoders raise, whatever the bytes."""

FARTHEST_M = 1e8
"""From a frame's origin; UTM northings reach 1e7 m."""
STRONGEST_M_S2 = 1e4
"""A hard landing has hundreds of m/s^2."""

_TYPES = protocol.STORE.types
_BATTERY_MEASURES = ("voltage", "temperature", "current", "charge", "capacity", "design_capacity")


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

    attitude: Triple | None
    angular_velocity_rad_s: Triple
    acceleration_m_s2: Triple
    """Specific force: +9.81 on z at rest."""
    stamp_ns: int
    """Since 1970, by the robot's clock."""
    frame_id: str = "imu_link"


def encode_twist(twist: Twist) -> bytes:
    """Return geometry_msgs/Twist.

    Raises:
        PlatformError: a component is NaN, infinite or beyond `FASTEST`.
    """
    return protocol.encode(write_twist(twist), protocol.TWIST)


def decode_twist(payload: bytes) -> Twist:
    """Return the velocity in a geometry_msgs/Twist; roll and pitch rates are checked and left out."""
    return read_twist(protocol.decode(payload, protocol.TWIST))


def encode_twist_stamped(twist: Twist, t_ns: int, frame_id: str) -> bytes:
    """Return geometry_msgs/TwistStamped; `t_ns` is since 1970, `frame_id` the body's frame.

    Raises:
        PlatformError: as `encode_twist`.
    """
    message = _TYPES[protocol.TWIST_STAMPED](header=write_header(t_ns, frame_id), twist=write_twist(twist))
    return protocol.encode(message, protocol.TWIST_STAMPED)


def decode_twist_stamped(payload: bytes) -> StampedTwist:
    """Return the velocity in a geometry_msgs/TwistStamped."""
    message = protocol.decode(payload, protocol.TWIST_STAMPED)
    return StampedTwist(read_twist(message.twist), read_stamp_ns(message.header), message.header.frame_id)


def encode_odometry(odometry: Odometry) -> bytes:
    """Return nav_msgs/Odometry with covariances of zero."""
    pose, unknown = odometry.pose, np.zeros(36)
    place = _TYPES["geometry_msgs/msg/Point"](x=pose.x, y=pose.y, z=pose.z)
    attitude = write_attitude((pose.roll, pose.pitch, pose.yaw))
    message = _TYPES[protocol.ODOMETRY](
        header=write_header(odometry.stamp_ns, odometry.frame_id),
        child_frame_id=odometry.child_frame_id,
        pose=_TYPES["geometry_msgs/msg/PoseWithCovariance"](
            pose=_TYPES["geometry_msgs/msg/Pose"](position=place, orientation=attitude), covariance=unknown
        ),
        twist=_TYPES["geometry_msgs/msg/TwistWithCovariance"](
            twist=write_twist(odometry.velocity), covariance=unknown
        ),
    )
    return protocol.encode(message, protocol.ODOMETRY)


def in_body(odometry: Odometry) -> Odometry:
    """Return an odometry whose velocity is in its own frame with the velocity in the body's."""
    return _turned(odometry, odometry.pose.rotation().T)


def in_odom(odometry: Odometry) -> Odometry:
    """Return an odometry with its velocity in the axes of its own frame, as Spot's driver tells it."""
    return _turned(odometry, odometry.pose.rotation())


def _turned(odometry: Odometry, rotation: Matrix) -> Odometry:
    velocity = odometry.velocity
    vx, vy, vz = (float(v) for v in rotation @ (velocity.vx, velocity.vy, velocity.vz))
    return replace(odometry, velocity=replace(velocity, vx=vx, vy=vy, vz=vz))


def decode_odometry(payload: bytes) -> Odometry:
    """Return the pose and the velocity in a nav_msgs/Odometry, in the message's own axes."""
    message = protocol.decode(payload, protocol.ODOMETRY)
    pose = message.pose.pose
    x, y, z = read_vector(pose.position, FARTHEST_M)
    roll, pitch, yaw = read_attitude(pose.orientation)
    return Odometry(
        pose=Pose(x, y, z, roll, pitch, yaw),
        velocity=read_twist(message.twist.twist),
        stamp_ns=read_stamp_ns(message.header),
        frame_id=message.header.frame_id,
        child_frame_id=message.child_frame_id,
    )


def encode_imu(imu: Imu) -> bytes:
    """Return sensor_msgs/Imu; without an attitude its covariance begins with -1, as the message asks."""
    unknown, absent = np.zeros(9), np.array([-1.0, *[0.0] * 8])
    message = _TYPES[protocol.IMU](
        header=write_header(imu.stamp_ns, imu.frame_id),
        orientation=write_attitude(imu.attitude or (0.0, 0.0, 0.0)),
        orientation_covariance=absent if imu.attitude is None else unknown,
        angular_velocity=write_vector(imu.angular_velocity_rad_s),
        angular_velocity_covariance=unknown,
        linear_acceleration=write_vector(imu.acceleration_m_s2),
        linear_acceleration_covariance=unknown,
    )
    return protocol.encode(message, protocol.IMU)


def decode_imu(payload: bytes) -> Imu:
    """Return what a sensor_msgs/Imu says."""
    message = protocol.decode(payload, protocol.IMU)
    return Imu(
        attitude=None if message.orientation_covariance[0] == -1 else read_attitude(message.orientation),
        angular_velocity_rad_s=read_vector(message.angular_velocity, FASTEST),
        acceleration_m_s2=read_vector(message.linear_acceleration, STRONGEST_M_S2),
        stamp_ns=read_stamp_ns(message.header),
        frame_id=message.header.frame_id,
    )


def encode_battery(charge: float | None, stamp_ns: int = 0) -> bytes:
    """Return sensor_msgs/BatteryState with this state of charge (0 to 1; None is unknown) and little else."""
    unknown = math.nan  # what the message asks for where nothing is measured
    message = _TYPES[protocol.BATTERY_STATE](
        header=write_header(stamp_ns, ""),
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
        header=write_header(image.stamp_ns, image.frame_id),
        format=image.format,
        data=np.frombuffer(image.data, np.uint8),
    )
    return protocol.encode(message, protocol.COMPRESSED_IMAGE)


def decode_compressed_image(payload: bytes) -> CompressedImage:
    """Return the image in a sensor_msgs/CompressedImage of at most `IMAGE_CAP_BYTES`."""
    try:
        return read_compressed_image(payload)
    except ValueError as error:
        raise Malformed(f"{protocol.COMPRESSED_IMAGE}: {error}") from error
