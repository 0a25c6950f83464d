"""Converts between ROS 2 messages and the toolkit's values: velocities, odometry, charge, images and lens.

Frames are REP 103's and REP 105's on both sides. Readers raise `Malformed`: no value that is not finite, no
quaternion that is not of unit length and no time before 1970 gets past them. Covariances are not read.
"""

from __future__ import annotations

import math
from dataclasses import astuple, dataclass, replace
from typing import Any

import geometry_msgs.msg
import nav_msgs.msg
import numpy as np
import sensor_msgs.msg
from numpy.typing import NDArray

from adatracker_deploy.core.camera import check_size
from adatracker_deploy.core.camera_info import CameraInfo
from adatracker_deploy.core.errors import PlatformError
from adatracker_deploy.core.geometry import Pose, Quaternion
from adatracker_deploy.core.messages import Twist
from adatracker_ros2.protocol import topics

FASTEST = 100.0
"""m/s and rad/s; nothing above this is a command or a measurement of a robot that follows people."""
FARTHEST_M = 1e8
"""From a frame's origin; UTM northings reach 1e7 m."""
IMAGE_CAP_BYTES = 8 << 20
"""Largest image that is looked at; a 1080p image has 6 MiB of raw pixels."""
_MOST_COEFFICIENTS = 14
"""OpenCV's longest model has as many."""
CHANNELS = {"rgb8": (0, 1, 2), "bgr8": (2, 1, 0), "mono8": (0, 0, 0), "rgba8": (0, 1, 2), "bgra8": (2, 1, 0)}
"""Positions of red, green and blue in a pixel, by sensor_msgs/Image's encoding (image_encodings.hpp)."""
_PIXEL_BYTES = {"rgb8": 3, "bgr8": 3, "mono8": 1, "rgba8": 4, "bgra8": 4}

TYPES: dict[str, Any] = {
    topics.TWIST: geometry_msgs.msg.Twist,
    topics.TWIST_STAMPED: geometry_msgs.msg.TwistStamped,
    topics.ODOMETRY: nav_msgs.msg.Odometry,
    topics.BATTERY_STATE: sensor_msgs.msg.BatteryState,
    topics.COMPRESSED_IMAGE: sensor_msgs.msg.CompressedImage,
    topics.IMAGE: sensor_msgs.msg.Image,
    topics.CAMERA_INFO: sensor_msgs.msg.CameraInfo,
}
"""Message classes by the names that a node's graph has for them."""


class Malformed(ValueError):  # noqa: N818 - what the message is
    """A message whose values cannot be; it is to be dropped and counted."""


@dataclass(frozen=True, slots=True)
class Odometry:
    """nav_msgs/Odometry: where the body is in a fixed frame, and its velocity in its own."""

    pose: Pose
    velocity: Twist
    stamp_ns: int
    """Since 1970, by the robot's clock."""


def write_command(type_name: str, twist: Twist, stamp_ns: int, frame_id: str) -> Any:
    """Return a Twist or a TwistStamped; `stamp_ns` is since 1970, `frame_id` the body's frame.

    Raises:
        PlatformError: a component is NaN, infinite or beyond `FASTEST`: it must not become a message.
    """
    if not all(abs(value) <= FASTEST for value in astuple(twist)):  # false for NaN too
        raise PlatformError(f"refused to send {twist}: not a velocity that a robot on the ground can have")
    message = TYPES[type_name]()
    velocity = message
    if type_name == topics.TWIST_STAMPED:
        write_header(message.header, stamp_ns, frame_id)
        velocity = message.twist
    _write_velocity(velocity, twist)
    return message


def read_command(message: Any) -> tuple[Twist, int | None]:
    """Return the velocity in a Twist or a TwistStamped, and when it was made by its sender's clock."""
    if hasattr(message, "header"):
        return _read_velocity(message.twist), read_stamp_ns(message.header)
    return _read_velocity(message), None


def write_odometry(odometry: Odometry) -> Any:
    """Return nav_msgs/Odometry with covariances of zero."""
    message = nav_msgs.msg.Odometry()
    write_header(message.header, odometry.stamp_ns, "odom")
    message.child_frame_id = "base_link"
    pose = odometry.pose
    place, turn = message.pose.pose.position, message.pose.pose.orientation
    place.x, place.y, place.z = pose.x, pose.y, pose.z
    turn.w, turn.x, turn.y, turn.z = Quaternion.of(pose.roll, pose.pitch, pose.yaw)
    _write_velocity(message.twist.twist, odometry.velocity)
    return message


def read_odometry(message: Any) -> Odometry:
    """Return the pose and the velocity in a nav_msgs/Odometry, in the message's own axes."""
    x, y, z = _triple(message.pose.pose.position, FARTHEST_M)
    roll, pitch, yaw = _attitude(message.pose.pose.orientation)
    return Odometry(
        Pose(x, y, z, roll, pitch, yaw), _read_velocity(message.twist.twist), read_stamp_ns(message.header)
    )


def in_body(odometry: Odometry) -> Odometry:
    """Return an odometry whose velocity is in its own frame with the velocity in the body's."""
    return _turned(odometry, odometry.pose.rotation().T)


def in_odom(odometry: Odometry) -> Odometry:
    """Return an odometry with its velocity in the axes of its own frame, as some drivers tell it."""
    return _turned(odometry, odometry.pose.rotation())


def write_battery(charge: float) -> Any:
    """Return sensor_msgs/BatteryState with this state of charge, 0 to 1, and little else."""
    message = sensor_msgs.msg.BatteryState()
    for name in ("voltage", "temperature", "current", "charge", "capacity", "design_capacity"):
        setattr(message, name, math.nan)  # what the message asks for where nothing is measured
    message.percentage, message.present = charge, True
    return message


def read_battery(message: Any) -> float | None:
    """Return the state of charge in a sensor_msgs/BatteryState, 0 to 1, or None where it says NaN: unknown.

    A percentage above 1 is `Malformed`: there are drivers that send 0 to 100, and 1 of those is not full.
    """
    charge = float(message.percentage)
    if math.isnan(charge):
        return None
    if not 0.0 <= charge <= 1.0:
        raise Malformed(f"battery percentage {charge:g} is not between 0 and 1")
    return charge


def write_compressed_image(data: bytes, stamp_ns: int, form: str) -> Any:
    """Return sensor_msgs/CompressedImage."""
    message = sensor_msgs.msg.CompressedImage()
    write_header(message.header, stamp_ns, "camera")
    message.format, message.data = form, data
    return message


def write_image(rgb: NDArray[np.uint8], stamp_ns: int) -> Any:
    """Return sensor_msgs/Image of an RGB picture of shape (H, W, 3)."""
    message = sensor_msgs.msg.Image()
    write_header(message.header, stamp_ns, "camera")
    message.height, message.width, message.step = rgb.shape[0], rgb.shape[1], 3 * rgb.shape[1]
    message.encoding, message.data = "rgb8", rgb.tobytes()
    return message


def read_image(message: Any) -> NDArray[np.uint8]:
    """Return the RGB picture, shape (H, W, 3), in a sensor_msgs/Image whose encoding is in `CHANNELS`."""
    height, width, step, encoding = message.height, message.width, message.step, message.encoding
    if encoding not in CHANNELS:
        raise Malformed(f"images in {encoding[:40]!r}: known are {', '.join(CHANNELS)}")
    try:
        check_size(width, height)
    except ValueError as error:
        raise Malformed(str(error)) from error
    pixel = _PIXEL_BYTES[encoding]
    if step < pixel * width or len(message.data) != step * height or len(message.data) > IMAGE_CAP_BYTES:
        raise Malformed(f"{len(message.data)} bytes are no {width}x{height} image of {step} bytes a row")
    rows = np.frombuffer(message.data, np.uint8).reshape(height, step)[:, : pixel * width]
    return np.ascontiguousarray(rows.reshape(height, width, pixel)[:, :, list(CHANNELS[encoding])])


def write_camera_info(lens: CameraInfo, stamp_ns: int) -> Any:
    """Return sensor_msgs/CameraInfo of a camera whose pictures keep their matrix when rectified."""
    message = sensor_msgs.msg.CameraInfo()
    write_header(message.header, stamp_ns, "camera")
    message.width, message.height = lens.width_px, lens.height_px
    message.distortion_model, message.d = lens.model, list(lens.coefficients)
    message.k = [lens.fx, 0.0, lens.cx, 0.0, lens.fy, lens.cy, 0.0, 0.0, 1.0]
    message.r = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]
    message.p = [lens.fx, 0.0, lens.cx, 0.0, 0.0, lens.fy, lens.cy, 0.0, 0.0, 0.0, 1.0, 0.0]
    return message


def read_camera_info(message: Any, *, rectified: bool) -> CameraInfo | None:
    """Return the lens in a sensor_msgs/CameraInfo; None where it says that the camera is not calibrated.

    Args:
        message: of a whole picture, a binned one, or a part of it: its matrices are of the whole one.
        rectified: its pictures are, so that the projection matrix is theirs, without distortion.
    """
    try:
        check_size(message.width, message.height)
    except ValueError as error:
        raise Malformed(str(error)) from error
    fx, cx, fy, cy = (
        (float(message.p[at]) for at in (0, 2, 5, 6))
        if rectified
        else (float(message.k[at]) for at in (0, 2, 4, 5))
    )
    if fx == 0.0:  # as the message's definition has it
        return None
    coefficients = () if rectified else tuple(float(value) for value in message.d)
    if not (0 < fx < math.inf and 0 < fy < math.inf and all(map(math.isfinite, (cx, cy, *coefficients)))):
        raise Malformed(f"focal lengths {fx:g} and {fy:g} with centre ({cx:g}, {cy:g}) are no lens's")
    if len(coefficients) > _MOST_COEFFICIENTS:
        raise Malformed(
            f"{len(coefficients)} coefficients of distortion: at most {_MOST_COEFFICIENTS} are known"
        )
    part = message.roi if message.roi.width and message.roi.height else None
    across, down = max(1, message.binning_x), max(1, message.binning_y)
    width, height = (part.width, part.height) if part else (message.width, message.height)
    left, top = (part.x_offset, part.y_offset) if part else (0, 0)
    return CameraInfo(
        width_px=width // across,
        height_px=height // down,
        fx=fx / across,
        fy=fy / down,
        cx=(cx - left) / across,
        cy=(cy - top) / down,
        model=message.distortion_model or "plumb_bob",
        coefficients=coefficients,
    )


def write_header(header: Any, stamp_ns: int, frame_id: str) -> None:
    """Fill a std_msgs/Header; `stamp_ns` is since 1970 and, in ROS 2's 32-bit seconds, before 2038."""
    header.stamp.sec, header.stamp.nanosec = divmod(stamp_ns, 10**9)
    header.frame_id = frame_id


def read_stamp_ns(header: Any) -> int:
    """Return the stamp of a std_msgs/Header, ns since 1970."""
    sec, nanosec = header.stamp.sec, header.stamp.nanosec
    if sec < 0 or nanosec >= 10**9:
        raise Malformed(f"no time has {sec} s and {nanosec} ns")
    return int(sec * 10**9 + nanosec)


def _write_velocity(message: Any, twist: Twist) -> None:
    linear, angular = message.linear, message.angular
    linear.x, linear.y, linear.z = float(twist.vx), float(twist.vy), float(twist.vz)
    angular.z = float(twist.yaw_rate)


def _read_velocity(message: Any) -> Twist:
    """Return the velocity in a geometry_msgs/Twist; roll and pitch rates are checked and left out."""
    vx, vy, vz = _triple(message.linear, FASTEST)
    _, _, yaw_rate = _triple(message.angular, FASTEST)
    return Twist(vx, vy, vz, yaw_rate)


def _triple(message: Any, largest: float) -> tuple[float, float, float]:
    xyz = (message.x, message.y, message.z)
    if not all(abs(value) <= largest for value in xyz):  # false for NaN too
        raise Malformed(f"{xyz} has a component that is not a number up to {largest:g}")
    return xyz


def _turned(odometry: Odometry, rotation: NDArray[np.float64]) -> Odometry:
    velocity = odometry.velocity
    vx, vy, vz = (float(v) for v in rotation @ (velocity.vx, velocity.vy, velocity.vz))
    return replace(odometry, velocity=replace(velocity, vx=vx, vy=vy, vz=vz))


def _attitude(quaternion: Any) -> tuple[float, float, float]:
    """Return roll, pitch and yaw, rad, as `Pose` means them."""
    try:
        return Quaternion(quaternion.w, quaternion.x, quaternion.y, quaternion.z).roll_pitch_yaw()
    except ValueError as error:
        raise Malformed(str(error)) from error
