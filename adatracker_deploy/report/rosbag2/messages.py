"""ROS 2 messages of what a trial's log holds. Pure.

Frames are REP 103's and REP 105's, as in the log: velocities in ``base_link``, poses in ``odom``. A number
that the log does not have is NaN, as sensor_msgs/BatteryState asks for where nothing is measured.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
from rosbags.typesys import Stores, get_typestore

from adatracker_deploy.core.geometry import Quaternion

if TYPE_CHECKING:
    from collections.abc import Sequence

    from adatracker_deploy.core.camera_info import CameraInfo
    from adatracker_deploy.core.geometry import Pose
    from adatracker_deploy.core.messages import Twist
    from adatracker_deploy.core.record import StepRecord

STORE = get_typestore(Stores.ROS2_JAZZY)
"""The types used here have the same fields from Humble to Lyrical."""

BATTERY = "sensor_msgs/msg/BatteryState"
CAMERA_INFO = "sensor_msgs/msg/CameraInfo"
DIAGNOSTICS = "diagnostic_msgs/msg/DiagnosticArray"
IMAGE = "sensor_msgs/msg/CompressedImage"
LOG = "rcl_interfaces/msg/Log"
MARKER = "visualization_msgs/msg/ImageMarker"
ODOMETRY = "nav_msgs/msg/Odometry"
TWIST = "geometry_msgs/msg/TwistStamped"

BODY, FIXED, CAMERA = "base_link", "odom", "camera"
_LEVELS = {"debug": 10, "info": 20, "warning": 30, "error": 40, "fatal": 50}
"""rcl_interfaces/msg/Log by the names of foxglove.Log."""
_OK, _WARN, _STALE = 0, 1, 3
_GREEN = (0.24, 0.86, 0.35, 1.0)
_LINE_PX = 2.0


def image(data: bytes, encoding: str, captured_ns: int) -> Any:
    """Return sensor_msgs/CompressedImage; `encoding` is ``jpeg`` or ``png``."""
    return _new(
        IMAGE, header=_header(captured_ns, CAMERA), format=encoding, data=np.frombuffer(data, np.uint8)
    )


def camera_info(lens: CameraInfo, captured_ns: int) -> Any:
    """Return sensor_msgs/CameraInfo of pictures that this lens took."""
    matrix = [lens.fx, 0.0, lens.cx, 0.0, lens.fy, lens.cy, 0.0, 0.0, 1.0]
    projection = [*matrix[:3], 0.0, *matrix[3:6], 0.0, *matrix[6:], 0.0]
    return _new(
        CAMERA_INFO,
        header=_header(captured_ns, CAMERA),
        height=lens.height_px,
        width=lens.width_px,
        distortion_model=lens.model,
        d=np.array(lens.coefficients, np.float64),
        k=np.array(matrix),
        r=np.eye(3).ravel(),
        p=np.array(projection),
        binning_x=0,
        binning_y=0,
        roi=_new(
            "sensor_msgs/msg/RegionOfInterest", x_offset=0, y_offset=0, height=0, width=0, do_rectify=False
        ),
    )


def twist(velocity: Twist, t_ns: int) -> Any:
    """Return geometry_msgs/TwistStamped."""
    return _new(TWIST, header=_header(t_ns, BODY), twist=_velocity(velocity))


def odometry(pose: Pose, velocity: Twist | None, measured_ns: int) -> Any:
    """Return nav_msgs/Odometry, without covariances; a velocity that is not known is NaN."""
    w, x, y, z = Quaternion.of(pose.roll, pose.pitch, pose.yaw)
    place = _new(
        "geometry_msgs/msg/Pose",
        position=_point(pose.x, pose.y, pose.z),
        orientation=_new("geometry_msgs/msg/Quaternion", x=x, y=y, z=z, w=w),
    )
    unsure = np.zeros(36)
    return _new(
        ODOMETRY,
        header=_header(measured_ns, FIXED),
        child_frame_id=BODY,
        pose=_new("geometry_msgs/msg/PoseWithCovariance", pose=place, covariance=unsure),
        twist=_new("geometry_msgs/msg/TwistWithCovariance", twist=_velocity(velocity), covariance=unsure),
    )


def battery(charge: float, measured_ns: int) -> Any:
    """Return sensor_msgs/BatteryState with this state of charge, 0 to 1, and little else."""
    unknown = dict.fromkeys(
        ("voltage", "temperature", "current", "charge", "capacity", "design_capacity"), math.nan
    )
    return _new(
        BATTERY,
        header=_header(measured_ns, BODY),
        **unknown,
        percentage=charge,
        power_supply_status=0,
        power_supply_health=0,
        power_supply_technology=0,
        present=True,
        cell_voltage=np.zeros(0, np.float32),
        cell_temperature=np.zeros(0, np.float32),
        location="",
        serial_number="",
    )


def marker(corners_px: Sequence[tuple[float, float]], captured_ns: int) -> Any:
    """Return visualization_msgs/ImageMarker: a polygon, or its removal where there are no corners."""
    colour = _new("std_msgs/msg/ColorRGBA", **dict(zip("rgba", _GREEN, strict=True)))
    return _new(
        MARKER,
        header=_header(captured_ns, CAMERA),
        ns="target",
        id=0,
        type=3,  # POLYGON
        action=0 if corners_px else 1,  # ADD, REMOVE
        position=_point(0.0, 0.0, 0.0),
        scale=_LINE_PX,
        outline_color=colour,
        filled=0,
        fill_color=colour,
        lifetime=_new("builtin_interfaces/msg/Duration", sec=0, nanosec=0),
        points=[_point(x, y, 0.0) for x, y in corners_px],
        outline_colors=[],
    )


def diagnostics(step: StepRecord, platform: str, t_ns: int) -> Any:
    """Return diagnostic_msgs/DiagnosticArray of a tick: the gate, the target, the robot and the loop's time.

    Numbers are texts there; they read back the same.
    """
    gate = _status("gate", ", ".join(step.gate), platform, _WARN if step.gate else _OK, {})
    seen = {"confidence": step.confidence, "frame_seq": step.frame_seq, "state": step.target}
    if step.box is not None:
        seen |= {name: getattr(step.box, name) for name in ("cx", "cy", "w", "h")}
    level = _STALE if step.stale else _OK if step.box is not None else _WARN
    words = "stale" if step.stale else "seen" if step.box is not None else "lost"
    robot = {"state_age_s": step.state_age_s, "driver": step.driver}
    latency = {name: getattr(step.latency, name) for name in step.latency.__slots__}
    latency |= {"missed_deadlines": step.missed_deadlines, "step": step.step}
    return _new(
        DIAGNOSTICS,
        header=_header(t_ns, ""),
        status=[
            gate,
            _status("target", words, platform, level, seen),
            _status("robot", step.mode, platform, _OK, robot),
            _status("loop", "", platform, _OK, latency),
        ],
    )


def log_line(level: str, text: str, t_ns: int) -> Any:
    """Return rcl_interfaces/Log, the type of /rosout; `level` is by foxglove.Log, in lower case."""
    return _new(
        LOG,
        stamp=_time(t_ns),
        level=_LEVELS.get(level, _LEVELS["info"]),
        name="adatracker",
        msg=text,
        file="",
        function="",
        line=0,
    )


def _status(name: str, message: str, platform: str, level: int, values: dict[str, Any]) -> Any:
    pairs = [
        _new("diagnostic_msgs/msg/KeyValue", key=key, value=str(value))
        for key, value in values.items()
        if value is not None
    ]
    return _new(
        "diagnostic_msgs/msg/DiagnosticStatus",
        level=level,
        name=f"adatracker: {name}",
        message=message,
        hardware_id=platform,
        values=pairs,
    )


def _new(type_name: str, **fields: Any) -> Any:
    return STORE.types[type_name](**fields)


def _header(stamp_ns: int, frame_id: str) -> Any:
    return _new("std_msgs/msg/Header", stamp=_time(stamp_ns), frame_id=frame_id)


def _time(t_ns: int) -> Any:
    sec, nanosec = divmod(t_ns, 10**9)
    return _new("builtin_interfaces/msg/Time", sec=sec, nanosec=nanosec)


def _point(x: float, y: float, z: float) -> Any:
    return _new("geometry_msgs/msg/Point", x=x, y=y, z=z)


def _velocity(velocity: Twist | None) -> Any:
    vx, vy, vz, yaw_rate = (
        (math.nan,) * 4 if velocity is None else (velocity.vx, velocity.vy, velocity.vz, velocity.yaw_rate)
    )
    turn = math.nan if velocity is None else 0.0
    return _new(
        "geometry_msgs/msg/Twist",
        linear=_new("geometry_msgs/msg/Vector3", x=vx, y=vy, z=vz),
        angular=_new("geometry_msgs/msg/Vector3", x=turn, y=turn, z=yaw_rate),
    )
