"""Unitree's own telemetry: SportModeState (pose, velocity, attitude) and LowState (charge) of a Go2.

Definitions: unitree_ros2, ``cyclonedds_ws/src/unitree/unitree_go/msg``. Every field has a fixed size. Some
SDKs append ten path points to a SportModeState (unitree_sdk2); they are cut off. Quaternions are w, x, y, z.
"""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
from rosbags.typesys import get_types_from_msg

from adatracker_deploy.core.geometry import Pose
from adatracker_deploy.core.messages import Twist
from adatracker_quadruped.protocol import cdr as protocol
from adatracker_quadruped.protocol.cdr import Malformed
from adatracker_quadruped.protocol.messages import FARTHEST_M, STRONGEST_M_S2, Imu, Odometry
from adatracker_quadruped.protocol.ros_types import (
    FASTEST,
    Triple,
    read_attitude,
    read_stamp_ns,
    read_vector,
    write_attitude,
)

SPORT_MODE_STATE = "unitree_go/msg/SportModeState"
LOW_STATE = "unitree_go/msg/LowState"

_DEFINITIONS = {
    "unitree_go/msg/TimeSpec": "int32 sec\nuint32 nanosec",
    "unitree_go/msg/IMUState": """
        float32[4] quaternion
        float32[3] gyroscope
        float32[3] accelerometer
        float32[3] rpy
        int8 temperature""",
    "unitree_go/msg/MotorState": """
        uint8 mode
        float32 q
        float32 dq
        float32 ddq
        float32 tau_est
        float32 q_raw
        float32 dq_raw
        float32 ddq_raw
        int8 temperature
        uint32 lost
        uint32[2] reserve""",
    "unitree_go/msg/BmsState": """
        uint8 version_high
        uint8 version_low
        uint8 status
        uint8 soc
        int32 current
        uint16 cycle
        int8[2] bq_ntc
        int8[2] mcu_ntc
        uint16[15] cell_vol""",
    SPORT_MODE_STATE: """
        TimeSpec stamp
        uint32 error_code
        IMUState imu_state
        uint8 mode
        float32 progress
        uint8 gait_type
        float32 foot_raise_height
        float32[3] position
        float32 body_height
        float32[3] velocity
        float32 yaw_speed
        float32[4] range_obstacle
        int16[4] foot_force
        float32[12] foot_position_body
        float32[12] foot_speed_body""",
    LOW_STATE: """
        uint8[2] head
        uint8 level_flag
        uint8 frame_reserve
        uint32[2] sn
        uint32[2] version
        uint16 bandwidth
        IMUState imu_state
        MotorState[20] motor_state
        BmsState bms_state
        int16[4] foot_force
        int16[4] foot_force_est
        uint32 tick
        uint8[40] wireless_remote
        uint8 bit_flag
        float32 adc_reel
        int8 temperature_ntc1
        int8 temperature_ntc2
        float32 power_v
        float32 power_a
        uint16[4] fan_frequency
        uint32 reserve
        uint32 crc""",
}
for _name, _definition in _DEFINITIONS.items():
    protocol.STORE.register(get_types_from_msg(_definition, _name))
for _name in (SPORT_MODE_STATE, LOW_STATE):
    protocol.STORE.get_msgdef(_name)  # compiled now, not at the first message
_TYPES = protocol.STORE.types

_PATH_BYTES = 10 * 7 * 4
"""Ten path points of seven float32."""


def _zeros(type_name: str) -> tuple[Any, int]:
    """Return a message of zeros, and its length as CDR with the encapsulation header."""
    definition = protocol.STORE.get_msgdef(type_name)
    body = memoryview(bytes(protocol.SMALL_CAP_BYTES))
    message, length = definition.deserialize_cdr_le(body, 0, definition.cls, protocol.STORE)
    return message, 4 + length


_STATE_BYTES = _zeros(SPORT_MODE_STATE)[1]


def decode_sport_mode_state(payload: bytes) -> Odometry:
    """Return the pose and the velocity in a SportModeState, in the axes in which the robot tells it."""
    message = _sport_mode_state(payload)
    x, y, z = _triple(message.position, FARTHEST_M)
    vx, vy, vz = _triple(message.velocity, FASTEST)
    (yaw_rate, _, _) = _triple((message.yaw_speed, 0.0, 0.0), FASTEST)
    roll, pitch, yaw = _attitude(message.imu_state)
    return Odometry(Pose(x, y, z, roll, pitch, yaw), Twist(vx, vy, vz, yaw_rate), read_stamp_ns(message))


def decode_sport_imu(payload: bytes) -> Imu:
    """Return the IMU in a SportModeState."""
    message = _sport_mode_state(payload)
    imu = message.imu_state
    return Imu(
        attitude=_attitude(imu),
        angular_velocity_rad_s=_triple(imu.gyroscope, FASTEST),
        acceleration_m_s2=_triple(imu.accelerometer, STRONGEST_M_S2),
        stamp_ns=read_stamp_ns(message),
    )


def encode_sport_mode_state(odometry: Odometry) -> bytes:
    """Return a SportModeState with this pose and velocity, of a robot that walks, and zeros elsewhere."""
    pose, velocity = odometry.pose, odometry.velocity
    turned = write_attitude((pose.roll, pose.pitch, pose.yaw))
    seconds, nanoseconds = divmod(odometry.stamp_ns, 10**9)
    message, _ = _zeros(SPORT_MODE_STATE)
    message.stamp.sec, message.stamp.nanosec = seconds, nanoseconds
    message.imu_state.quaternion = np.array([turned.w, turned.x, turned.y, turned.z], np.float32)
    message.imu_state.rpy = np.array([pose.roll, pose.pitch, pose.yaw], np.float32)
    message.mode, message.gait_type = 3, 1  # locomotion, trot
    message.position = np.array([pose.x, pose.y, pose.z], np.float32)
    message.velocity = np.array([velocity.vx, velocity.vy, velocity.vz], np.float32)
    message.yaw_speed = velocity.yaw_rate
    return protocol.encode(message, SPORT_MODE_STATE)


def decode_low_state(payload: bytes) -> float:
    """Return the state of charge in a LowState, 0 to 1."""
    percent = int(protocol.decode(payload, LOW_STATE).bms_state.soc)
    if percent > 100:
        raise Malformed(f"a charge of {percent} % is not between 0 and 100")
    return percent / 100


def encode_low_state(charge: float) -> bytes:
    """Return a LowState with this state of charge, 0 to 1, and zeros elsewhere."""
    message, _ = _zeros(LOW_STATE)
    message.bms_state.soc = round(100 * charge)
    return protocol.encode(message, LOW_STATE)


def _sport_mode_state(payload: bytes) -> Any:
    if len(payload) >= _STATE_BYTES + _PATH_BYTES:
        payload = payload[:_STATE_BYTES]
    return protocol.decode(payload, SPORT_MODE_STATE)


def _attitude(imu: Any) -> Triple:
    w, x, y, z = (float(part) for part in imu.quaternion)
    return read_attitude(SimpleNamespace(x=x, y=y, z=z, w=w))


def _triple(values: Any, largest: float) -> Triple:
    x, y, z = (float(value) for value in values)
    return read_vector(SimpleNamespace(x=x, y=y, z=z), largest)
