"""Builds a PX4 vehicle's telemetry messages from one instant."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from pymavlink.dialects.v20 import common as mavlink

from adatracker_deploy.core.geometry import Quaternion
from adatracker_drone.protocol.dialect import CurrentMode
from adatracker_drone.sim.commander import Commander
from adatracker_drone.sim.motion import HOME_ALTITUDE_M, HOME_LATITUDE_DEG, HOME_LONGITUDE_DEG, Motion

Message = Any
"""One of pymavlink's generated message classes."""

_EARTH_M = 6_371_000.0
"""Mean radius; PX4's local frame is an azimuthal projection on such a sphere."""
_SENSORS = (
    mavlink.MAV_SYS_STATUS_SENSOR_3D_GYRO
    | mavlink.MAV_SYS_STATUS_SENSOR_3D_ACCEL
    | mavlink.MAV_SYS_STATUS_SENSOR_3D_MAG
    | mavlink.MAV_SYS_STATUS_SENSOR_ABSOLUTE_PRESSURE
    | mavlink.MAV_SYS_STATUS_SENSOR_GPS
    | mavlink.MAV_SYS_STATUS_AHRS
    | mavlink.MAV_SYS_STATUS_SENSOR_BATTERY
)
_CELLS = 3
_FULL_CELL_V, _EMPTY_CELL_V = 4.05, 3.6
"""BAT1_V_CHARGED, BAT1_V_EMPTY."""
_FLYING_A, _IDLE_A = 14.0, 0.5


@dataclass(frozen=True, slots=True)
class Instant:
    """The state that messages are made from."""

    t_ns: int
    """Since power-on."""
    estimate: Motion
    commander: Commander
    ready: bool
    uid: bytes


def global_position(motion: Motion) -> tuple[int, int, int]:
    """Return latitude and longitude in 1e-7 degrees and the height above sea level in mm."""
    latitude = HOME_LATITUDE_DEG + math.degrees(motion.north / _EARTH_M)
    shrink = math.cos(math.radians(HOME_LATITUDE_DEG))
    longitude = HOME_LONGITUDE_DEG + math.degrees(motion.east / (_EARTH_M * shrink))
    return round(latitude * 1e7), round(longitude * 1e7), round((HOME_ALTITUDE_M + motion.altitude) * 1e3)


def _ms(now: Instant) -> int:
    return now.t_ns // 1_000_000 % 2**32


def _heading_cdeg(motion: Motion) -> int:
    return round(math.degrees(motion.heading) * 100) % 36000


def _voltage_mv(now: Instant) -> int:
    cell = _EMPTY_CELL_V + now.commander.battery * (_FULL_CELL_V - _EMPTY_CELL_V)
    return round(_CELLS * cell * 1000)


def _current_ca(now: Instant) -> int:
    flying = now.commander.armed and not now.commander.landed
    return round(100 * (_FLYING_A if flying else _IDLE_A))


def heartbeat(now: Instant) -> Message:
    """Say what this is and in which mode."""
    commander = now.commander
    base = mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED | mavlink.MAV_MODE_FLAG_STABILIZE_ENABLED
    base |= mavlink.MAV_MODE_FLAG_SAFETY_ARMED if commander.armed else 0
    if commander.mode.is_auto:
        base |= mavlink.MAV_MODE_FLAG_AUTO_ENABLED | mavlink.MAV_MODE_FLAG_GUIDED_ENABLED
    else:
        base |= mavlink.MAV_MODE_FLAG_MANUAL_INPUT_ENABLED
    state = mavlink.MAV_STATE_STANDBY if now.ready else mavlink.MAV_STATE_UNINIT
    if commander.failsafe:
        state = mavlink.MAV_STATE_CRITICAL
    elif commander.armed:
        state = mavlink.MAV_STATE_ACTIVE
    return mavlink.MAVLink_heartbeat_message(
        mavlink.MAV_TYPE_QUADROTOR,
        mavlink.MAV_AUTOPILOT_PX4,
        base,
        commander.mode.custom_mode,
        state,
        mavlink_version=3,
    )


def current_mode(now: Instant) -> Message:
    """Tell the mode that flies, and the one that was asked for."""
    return CurrentMode(now.commander.mode.custom_mode, now.commander.wanted.custom_mode)


def timesync(now: Instant) -> Message:
    """Ask for the other end's time."""
    return mavlink.MAVLink_timesync_message(0, now.t_ns)


def attitude(now: Instant) -> Message:
    """Tell roll, pitch and heading and the body's rates."""
    m = now.estimate
    return mavlink.MAVLink_attitude_message(_ms(now), m.roll, m.pitch, m.heading, m.p, m.q, m.r)


def attitude_quaternion(now: Instant) -> Message:
    """Tell the attitude as w, x, y, z."""
    m = now.estimate
    turned = Quaternion.of(m.roll, m.pitch, m.heading)
    return mavlink.MAVLink_attitude_quaternion_message(_ms(now), *turned, m.p, m.q, m.r)


def local_position(now: Instant) -> Message:
    """Tell place and velocity in the local frame."""
    m = now.estimate
    return mavlink.MAVLink_local_position_ned_message(
        _ms(now), m.north, m.east, m.down, m.v_north, m.v_east, m.v_down
    )


def odometry(now: Instant) -> Message:
    """Tell place, attitude and body velocity at once."""
    m = now.estimate
    q = attitude_quaternion(now)
    c, s = math.cos(m.heading), math.sin(m.heading)
    unknown = [math.nan] + [0.0] * 20
    return mavlink.MAVLink_odometry_message(
        now.t_ns // 1000,
        mavlink.MAV_FRAME_LOCAL_NED,
        mavlink.MAV_FRAME_BODY_FRD,
        m.north,
        m.east,
        m.down,
        [q.q1, q.q2, q.q3, q.q4],
        c * m.v_north + s * m.v_east,
        c * m.v_east - s * m.v_north,
        m.v_down,
        m.p,
        m.q,
        m.r,
        unknown,
        unknown,
    )


def global_position_int(now: Instant) -> Message:
    """Tell place and velocity on Earth."""
    m = now.estimate
    latitude, longitude, height = global_position(m)
    velocity = [round(v * 100) for v in (m.v_north, m.v_east, m.v_down)]
    return mavlink.MAVLink_global_position_int_message(
        _ms(now), latitude, longitude, height, round(m.altitude * 1000), *velocity, _heading_cdeg(m)
    )


def gps_raw_int(now: Instant) -> Message:
    """Tell what the receiver sees."""
    m = now.estimate
    latitude, longitude, height = global_position(m)
    speed = math.hypot(m.v_north, m.v_east)
    course = round(math.degrees(math.atan2(m.v_east, m.v_north)) * 100) % 36000
    return mavlink.MAVLink_gps_raw_int_message(
        now.t_ns // 1000,
        mavlink.GPS_FIX_TYPE_3D_FIX,
        latitude,
        longitude,
        height,
        70,  # horizontal dilution of precision, 0.01
        110,
        round(speed * 100),
        course,
        14,  # satellites
    )


def altitude(now: Instant) -> Message:
    """Tell the height against each reference."""
    m = now.estimate
    above_sea = HOME_ALTITUDE_M + m.altitude
    return mavlink.MAVLink_altitude_message(
        now.t_ns // 1000, above_sea, above_sea, m.altitude, m.altitude, m.altitude, math.nan
    )


def vfr_hud(now: Instant) -> Message:
    """Tell what a pilot's display shows."""
    m = now.estimate
    speed = math.hypot(m.v_north, m.v_east)
    throttle = 0 if now.commander.landed else 42
    return mavlink.MAVLink_vfr_hud_message(
        speed, speed, _heading_cdeg(m) // 100, throttle, HOME_ALTITUDE_M + m.altitude, -m.v_down
    )


def sys_status(now: Instant) -> Message:
    """Tell which sensors work, whether the vehicle could arm, and the battery."""
    armable = mavlink.MAV_SYS_STATUS_PREARM_CHECK
    healthy = _SENSORS | (armable if now.ready else 0)
    return mavlink.MAVLink_sys_status_message(
        _SENSORS | armable,
        _SENSORS | armable,
        healthy,
        300,  # load, 0.1 %
        _voltage_mv(now),
        _current_ca(now),
        round(100 * now.commander.battery),
        *[0] * 6,
    )


def battery_status(now: Instant) -> Message:
    """Tell the battery in detail."""
    cell = _voltage_mv(now) // _CELLS
    return mavlink.MAVLink_battery_status_message(
        0,
        mavlink.MAV_BATTERY_FUNCTION_ALL,
        mavlink.MAV_BATTERY_TYPE_LIPO,
        2**15 - 1,  # temperature unknown
        [cell] * _CELLS + [2**16 - 1] * (10 - _CELLS),
        _current_ca(now),
        -1,
        -1,
        round(100 * now.commander.battery),
    )


def extended_sys_state(now: Instant) -> Message:
    """Return whether it flies."""
    return mavlink.MAVLink_extended_sys_state_message(
        mavlink.MAV_VTOL_STATE_UNDEFINED, now.commander.landed_state
    )


def home_position(now: Instant) -> Message:
    """Tell where home is: the origin of the local frame."""
    return mavlink.MAVLink_home_position_message(
        *global_position(Motion()), 0.0, 0.0, 0.0, [1.0, 0.0, 0.0, 0.0], 0.0, 0.0, 0.0, now.t_ns // 1000
    )


def gps_global_origin(now: Instant) -> Message:
    """Tell where the local frame's origin is."""
    return mavlink.MAVLink_gps_global_origin_message(*global_position(Motion()), now.t_ns // 1000)


def system_time(now: Instant) -> Message:
    """Tell the time since power-on; the simulated vehicle knows no calendar."""
    return mavlink.MAVLink_system_time_message(0, _ms(now))


def estimator_status(now: Instant) -> Message:
    """Tell that the estimator is content, once it is."""
    good = 0x33F if now.ready else 0  # attitude, velocity, relative and absolute position
    return mavlink.MAVLink_estimator_status_message(
        now.t_ns // 1000, good, 0.05, 0.05, 0.05, 0.02, 0.0, 0.0, 0.3, 0.4
    )


def autopilot_version(now: Instant) -> Message:
    """Tell what this autopilot can do."""
    can = (
        mavlink.MAV_PROTOCOL_CAPABILITY_MISSION_INT
        | mavlink.MAV_PROTOCOL_CAPABILITY_COMMAND_INT
        | mavlink.MAV_PROTOCOL_CAPABILITY_PARAM_ENCODE_BYTEWISE
        | mavlink.MAV_PROTOCOL_CAPABILITY_SET_POSITION_TARGET_LOCAL_NED
        | mavlink.MAV_PROTOCOL_CAPABILITY_MAVLINK2
    )
    v1_16_0 = 1 << 24 | 16 << 16 | 255  # 255: a release
    return mavlink.MAVLink_autopilot_version_message(
        can, v1_16_0, v1_16_0, 0, 0, [0] * 8, [0] * 8, [0] * 8, 0x26AC, 0x10, 1, list(now.uid)
    )
