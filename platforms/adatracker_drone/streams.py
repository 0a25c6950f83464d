"""How often each message is sent: PX4's onboard link by default, changed by SET_MESSAGE_INTERVAL. Pure."""

from __future__ import annotations

import math
from collections.abc import Callable

from pymavlink.dialects.v20 import common as mavlink

from adatracker_drone import telemetry
from adatracker_drone.telemetry import Instant, Message

STREAMS: dict[int, tuple[Callable[[Instant], Message], float]] = {
    mavlink.MAVLINK_MSG_ID_HEARTBEAT: (telemetry.heartbeat, 1.0),
    mavlink.MAVLINK_MSG_ID_SYS_STATUS: (telemetry.sys_status, 5.0),
    mavlink.MAVLINK_MSG_ID_ATTITUDE: (telemetry.attitude, 100.0),
    mavlink.MAVLINK_MSG_ID_ATTITUDE_QUATERNION: (telemetry.attitude_quaternion, 50.0),
    mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED: (telemetry.local_position, 30.0),
    mavlink.MAVLINK_MSG_ID_ODOMETRY: (telemetry.odometry, 30.0),
    mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: (telemetry.global_position_int, 50.0),
    mavlink.MAVLINK_MSG_ID_GPS_RAW_INT: (telemetry.gps_raw_int, 5.0),
    mavlink.MAVLINK_MSG_ID_ALTITUDE: (telemetry.altitude, 10.0),
    mavlink.MAVLINK_MSG_ID_VFR_HUD: (telemetry.vfr_hud, 10.0),
    mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: (telemetry.extended_sys_state, 2.0),
    mavlink.MAVLINK_MSG_ID_BATTERY_STATUS: (telemetry.battery_status, 0.5),
    mavlink.MAVLINK_MSG_ID_HOME_POSITION: (telemetry.home_position, 0.5),
    mavlink.MAVLINK_MSG_ID_SYSTEM_TIME: (telemetry.system_time, 1.0),
    mavlink.MAVLINK_MSG_ID_ESTIMATOR_STATUS: (telemetry.estimator_status, 1.0),
    mavlink.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN: (telemetry.gps_global_origin, 0.0),
    mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION: (telemetry.autopilot_version, 0.0),
}
"""What makes each message, and its rate in Hz; 0 is on request only."""

FASTEST_HZ = 250.0
"""The simulation's own rate."""


class Schedule:
    """When each stream is due next."""

    def __init__(self) -> None:
        self._rates = {number: rate for number, (_, rate) in STREAMS.items()}
        self._due_s = dict.fromkeys(STREAMS, 0.0)

    def set_interval(self, number: int, interval_us: float) -> bool:
        """Change a stream's rate: 0 is the default, negative is off; False if there is no such stream."""
        if number not in STREAMS or not math.isfinite(interval_us):
            return False
        if interval_us == 0:
            self._rates[number] = STREAMS[number][1]
        else:
            self._rates[number] = min(1e6 / interval_us, FASTEST_HZ) if interval_us > 0 else 0.0
        self._due_s[number] = 0.0
        return True

    def due(self, now: Instant) -> list[Message]:
        """Return what is due; a stream that is late is sent once, not for every slot it missed."""
        messages, now_s = [], now.t_ns / 1e9
        for number, rate_hz in self._rates.items():
            if rate_hz > 0 and now_s >= self._due_s[number]:
                period_s = 1 / rate_hz
                self._due_s[number] = max(self._due_s[number] + period_s, now_s + period_s / 2)
                messages.append(STREAMS[number][0](now))
        return messages
