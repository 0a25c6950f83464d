"""Components of ROS 2 messages: reads and writes stamps, vectors, velocities and attitudes.

Readers raise `Malformed`: no value that is not finite, no quaternion that is not of unit length and no time
before 1970 gets past them.
"""

from __future__ import annotations

from dataclasses import astuple
from typing import Any

from adatracker_deploy.core.errors import PlatformError
from adatracker_deploy.core.geometry import Quaternion
from adatracker_deploy.core.messages import Twist
from adatracker_quadruped.protocol.cdr import STORE, TWIST, Malformed

Triple = tuple[float, float, float]

FASTEST = 100.0
"""m/s and rad/s; nothing above this is a command or a measurement of a walking robot."""


def write_header(stamp_ns: int, frame_id: str) -> Any:
    """Return std_msgs/Header; `stamp_ns` is since 1970 and, in ROS 2's 32-bit seconds, before 2038."""
    time = STORE.types["builtin_interfaces/msg/Time"](sec=stamp_ns // 10**9, nanosec=stamp_ns % 10**9)
    return STORE.types["std_msgs/msg/Header"](stamp=time, frame_id=frame_id)


def read_stamp_ns(header: Any) -> int:
    """Return the stamp of a std_msgs/Header, ns since 1970."""
    sec, nanosec = header.stamp.sec, header.stamp.nanosec
    if sec < 0 or nanosec >= 10**9:
        raise Malformed(f"no time has {sec} s and {nanosec} ns")
    return int(sec * 10**9 + nanosec)


def write_vector(xyz: Triple) -> Any:
    """Return geometry_msgs/Vector3."""
    x, y, z = xyz
    return STORE.types["geometry_msgs/msg/Vector3"](x=x, y=y, z=z)


def read_vector(message: Any, largest: float) -> Triple:
    """Return the x, y and z of a geometry_msgs/Vector3 or Point, each of this magnitude at most."""
    xyz = (message.x, message.y, message.z)
    if not all(abs(value) <= largest for value in xyz):  # false for NaN too
        raise Malformed(f"{xyz} has a component that is not a number up to {largest:g}")
    return xyz


def refuse_unwalkable(twist: Twist) -> None:
    """Raise PlatformError if a component is NaN, infinite or beyond `FASTEST`: it must not become bytes."""
    if not all(abs(value) <= FASTEST for value in astuple(twist)):
        raise PlatformError(f"refused to send {twist}: not a velocity that a quadruped can walk")


def write_twist(twist: Twist) -> Any:
    """Return geometry_msgs/Twist.

    Raises:
        PlatformError: as `refuse_unwalkable`.
    """
    refuse_unwalkable(twist)
    linear = write_vector((twist.vx, twist.vy, twist.vz))
    return STORE.types[TWIST](linear=linear, angular=write_vector((0.0, 0.0, twist.yaw_rate)))


def read_twist(message: Any) -> Twist:
    """Return the velocity in a geometry_msgs/Twist; roll and pitch rates are checked and left out."""
    vx, vy, vz = read_vector(message.linear, FASTEST)
    _, _, yaw_rate = read_vector(message.angular, FASTEST)
    return Twist(vx, vy, vz, yaw_rate)


def write_attitude(roll_pitch_yaw: Triple) -> Any:
    """Return the geometry_msgs/Quaternion of Rz(yaw) Ry(pitch) Rx(roll), which is what `Pose` means."""
    w, x, y, z = Quaternion.of(*roll_pitch_yaw)
    return STORE.types["geometry_msgs/msg/Quaternion"](x=x, y=y, z=z, w=w)


def read_attitude(quaternion: Any) -> Triple:
    """Return roll, pitch and yaw of a geometry_msgs/Quaternion, rad, as `Pose` means them."""
    try:
        return Quaternion(quaternion.w, quaternion.x, quaternion.y, quaternion.z).roll_pitch_yaw()
    except ValueError as error:
        raise Malformed(str(error)) from error
